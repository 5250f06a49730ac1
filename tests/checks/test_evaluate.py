"""`noslip evaluate` and `noslip check`: values against an independent derivation, statuses, bad input."""

import copy
import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from noslip.checks.verification.evaluate import evaluate_cases
from noslip.checks.verification.sampling import random_plants
from noslip.cli.main import main
from noslip.model.law import symbols
from noslip.model.outputs import OUTPUTS
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_laws, find_robot, law_of, system_of
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.controller import BACKENDS, MODEL_QUANTITIES, QUANTITIES
from noslip.simulation.specification.cases import read_cases
from scipy.optimize import brentq

REFERENCE = Path(__file__).parents[2] / "examples/specs" / "reference"
FILES = ("labmate_paper.json", "labmate_random.json")
WORST = {"casadi": 1e-11, "c": 1e-11, "cf": 1e-3}  # of each quantity's largest entry
MEDIAN = {"casadi": 2e-14, "c": 2e-14, "cf": 5e-6}

each_backend = pytest.mark.parametrize("backend", BACKENDS)


@pytest.fixture
def case() -> dict:
    """One regular Type IV case on a circle."""
    cases = json.loads((REFERENCE / FILES[0]).read_text())["cases"]
    return copy.deepcopy(next(c for c in cases if c["output"].get("path", {}).get("kind") == "circle"))


@pytest.fixture
def write(tmp_path):
    """Writes cases (or any text) to a file and answers its name."""

    def write(content, **top) -> str:
        path = tmp_path / "cases.json"
        path.write_text(content if isinstance(content, str) else json.dumps({"cases": content, **top}))
        return str(path)

    return write


def statuses(path: str, backend: str) -> list[str]:
    return [evaluation.status for evaluation in evaluate_cases(read_cases(path), backend)]


# -- values --------------------------------------------------------------------------------------------------


@each_backend
@pytest.mark.parametrize("file", FILES)
def test_reference_values(file, backend, tmp_path):
    out = tmp_path / "out.json"
    assert main(["evaluate", str(REFERENCE / file), "--backend", backend, "-o", str(out)]) == 0
    cases = json.loads((REFERENCE / file).read_text())["cases"]
    answers = json.loads(out.read_text())["cases"]
    assert [answer["status"] for answer in answers] == ["ok"] * len(cases)
    for name in QUANTITIES + (MODEL_QUANTITIES if backend == "casadi" else ()):
        errors = []
        for expected, answer in zip(
            (np.array(c["expect"][name], float) for c in cases), answers, strict=True
        ):
            value = np.array(answer[name])
            assert value.shape == expected.shape
            errors.append(np.abs(value - expected).max() / max(np.abs(expected).max(), 1e-3))
        assert max(errors) <= WORST[backend], name
        assert np.median(errors) <= MEDIAN[backend], name


def test_numbers_read_back_to_the_same_bits(tmp_path):
    path, out = str(REFERENCE / FILES[1]), tmp_path / "out.json"
    main(["evaluate", path, "--backend", "casadi", "-o", str(out)])
    for evaluation, answer in zip(
        evaluate_cases(read_cases(path), "casadi"), json.loads(out.read_text())["cases"], strict=True
    ):
        assert {name: np.array(answer[name]).tolist() for name in evaluation.values} == {
            name: value.tolist() for name, value in evaluation.values.items()
        }


def test_numbers_may_be_strings_or_json_numbers(case, write):
    def as_numbers(value):
        if isinstance(value, dict):
            return {k: v if k in ("type", "kind") else as_numbers(v) for k, v in value.items()}
        return [as_numbers(v) for v in value] if isinstance(value, list) else float(value)

    one, other = evaluate_cases(read_cases(write([case, as_numbers(case)])), "casadi")
    assert all(np.array_equal(one.values[name], other.values[name]) for name in one.values)


def test_gain_named_in_full_goes_first(case, write):
    named = {
        **case,
        "gains": {
            "kp": "99",
            "kp_distance": case["gains"]["kp"],
            "kd": case["gains"]["kd"],
            "kv_speed": case["gains"]["kv"],
        },
    }
    one, other = read_cases(write([case, named]))
    assert one.gains == other.gains


def test_a_law_may_be_named(case, write):
    named = copy.deepcopy(case)
    named["output"]["type"] = "type_iv_circle"
    del named["output"]["path"]["kind"]
    one, other = read_cases(write([case, named]))
    assert one.law is other.law and one.config == other.config


def test_expect_is_optional(case, write):
    del case["expect"]
    assert statuses(write([case]), "casadi") == ["ok"]


def test_robot_of_a_file(case, write, tmp_path):
    (tmp_path / "mine.py").write_text("from noslip.model.robots.labmate import labmate\nmine = labmate()\n")
    assert statuses(write([case], robot=f"{tmp_path / 'mine.py'}:mine"), "casadi") == ["ok"]


def test_every_law_fits_the_labmate():
    assert find_laws(system_of(find_robot("labmate"))) == tuple(OUTPUTS)


@each_backend
@pytest.mark.parametrize("shape", [(1, 7), (7, 1), (6,), (8,), ()])
def test_a_state_of_the_wrong_shape_is_refused(backend, shape):
    """A number or a row in the place of a vector would be taken for all of it. So with the reference."""
    law = law_of(find_robot("labmate"), "type_i")
    (plant,) = random_plants(law, 1, seed=16)
    controller = make_controller(backend, law, plant.params, plant.config, plant.gains)
    reference = np.zeros(len(law.reference))
    for ask in (controller.step, controller.evaluate):
        with pytest.raises(BadInput, match=r"type_i: state has shape .*; give 7 numbers: x_c, "):
            ask(np.full(shape, 0.1), reference)
        with pytest.raises(BadInput, match="type_i: reference has shape"):
            ask(plant.points[0].state, reference[None, :])


@each_backend
@pytest.mark.parametrize("name", OUTPUTS)
def test_step_and_evaluate_agree(name, backend):
    limit = {"casadi": 0, "c": 1e-12, "cf": 1e-4}[backend]
    law = law_of(find_robot("labmate"), name)
    for plant in random_plants(law, 40, seed=5):
        controller = make_controller(backend, law, plant.params, plant.config, plant.gains)
        for point in plant.points:
            status, tau = controller.step(point.state, point.reference)
            assert status == "ok"
            # Optimized by itself: other roundings
            together = controller.evaluate(point.state, point.reference).values["tau"]
            assert np.abs(tau - together).max() <= limit * np.abs(together).max()


# -- statuses ------------------------------------------------------------------------------------------------


@each_backend
@pytest.mark.parametrize("bad", ["nan", "inf", "-Infinity", math.nan, math.inf, "1e999"])
@pytest.mark.parametrize(
    "place",
    [("q", 0), ("q", 3), ("nu", 1), ("reference", "y", 0), ("reference", "yd", 1), ("reference", "ydd", 1)],
)
def test_number_that_is_not_finite(case, write, backend, place, bad):
    good = copy.deepcopy(case)
    target = case
    for key in place[:-1]:
        target = target[key]
    target[place[-1]] = bad
    assert statuses(write([good, case, good]), backend) == ["ok", "nonfinite", "ok"]


@each_backend
def test_status_stands_alone(case, write, backend, tmp_path):
    case["q"][2] = "nan"
    out = tmp_path / "out.json"
    assert main(["evaluate", write([case]), "--backend", backend, "-o", str(out)]) == 0
    assert json.loads(out.read_text()) == {"cases": [{"status": "nonfinite"}]}


@each_backend
@pytest.mark.parametrize(
    ("group", "name", "bad"),
    [
        ("params", "r", "0"),
        ("params", "m_c", -1),
        ("params", "d", "nan"),
        ("params", "I_w", "inf"),
        ("gains", "kp", -1),
    ],
)
def test_parameter_that_is_refused(case, write, backend, group, name, bad):
    good = copy.deepcopy(case)
    case[group][name] = bad
    refused = "nonfinite" if bad in ("nan", "inf") else "bad_parameter"
    assert statuses(write([case, good]), backend) == [refused, "ok"]


@each_backend
def test_path_that_does_not_exist(case, write, backend):
    line = copy.deepcopy(case)
    line["output"]["path"] = {"kind": "line", "A": 0, "B": 0, "C": 1}
    case["output"]["path"]["R"] = "-10"
    assert statuses(write([line, case]), backend) == ["bad_parameter", "bad_parameter"]


def normal_to_circle(case: dict, off: float) -> dict:
    """The case with its heading `off` rad away from the direction to the centre."""
    turned = copy.deepcopy(case)
    x, y = (float(value) for value in case["q"][:2])
    x_f, y_f = (float(case["output"]["path"][key]) for key in ("x_f", "y_f"))
    turned["q"][2] = math.atan2(y_f - y, x_f - x) + off
    turned["output"]["L"] = 0.0
    return turned


@each_backend
def test_heading_normal_to_the_path_is_singular(case, write, backend):
    cases = [normal_to_circle(case, off) for off in (0.0, math.pi, 1e-7, 0.01, -0.01)]
    assert statuses(write(cases), backend) == ["singular", "singular", "singular", "ok", "ok"]


@each_backend
def test_point_on_the_axle_is_singular(case, write, backend):
    case["output"]["L"] = -float(case["params"]["d"])
    on_axle = copy.deepcopy(case)
    on_axle["output"] = {"type": "I", "L": case["output"]["L"]}
    assert statuses(write([case, on_axle]), backend) == ["singular", "singular"]


def test_singular_alike_at_random_states(case, write):
    """Either side of the limit, a factor of two away from it so that rounding in float does not decide."""
    random = np.random.default_rng(11)
    cases = []
    for _ in range(100):
        turned = copy.deepcopy(case)
        turned["q"] = [*random.uniform(-5, 5, 2), 0.0, *random.uniform(-20, 20, 2)]
        off = random.choice((-1, 1)) * random.choice((1e-7, 1e-6, 1e-3, 1e-2))
        cases.append(normal_to_circle(turned, off + random.choice((0, math.pi))))
    path = write(cases)
    expected = statuses(path, "casadi")
    assert {"ok", "singular"} == set(expected)
    assert statuses(path, "c") == expected
    assert statuses(path, "cf") == expected


@pytest.mark.parametrize(("backend", "limit"), [("casadi", 2.0**20), ("c", 2.0**20), ("cf", 8192.0)])
def test_angle_beyond_the_range_of_the_sine(case, write, backend, limit):
    cases = []
    for angle in (
        limit,
        -limit,
        math.nextafter(limit, math.inf) if backend != "cf" else 8192.001,
        -2 * limit,
    ):
        turned = copy.deepcopy(case)
        turned["q"][2] = angle
        cases.append(turned)
    wheels = copy.deepcopy(case)
    wheels["q"][3:] = [1e7, -1e7]  # no sine is taken of the wheels' angles
    assert statuses(write([*cases, wheels]), backend) == ["ok", "ok", "range", "range", "ok"]


# -- check ---------------------------------------------------------------------------------------------------


def test_check_of_files(capsys):
    assert main(["check", *(str(REFERENCE / file) for file in FILES)]) == 0
    assert capsys.readouterr().out.count("all errors are within the limits") == 1


@each_backend
def test_check_finds_a_wrong_value(case, write, backend, capsys):
    good = copy.deepcopy(case)
    case["expect"]["tau"][1] = float(case["expect"]["tau"][1]) * 1.001
    path = write([good, case])
    assert main(["check", path, "--backend", backend]) == 1
    out = capsys.readouterr().out
    assert f"{backend}: tau has an error of" in out and f"{path}: case 1" in out
    assert main(["check", path, "--backend", backend, "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False and len(answer["failures"]) == 1
    assert (
        answer["files"][0]["backends"][backend]["tau"]["worst"]
        > 1e-4
        > answer["files"][0]["backends"][backend]["u"]["worst"]
    )


@pytest.mark.parametrize(("count", "judged"), [(15, False), (16, True)])
def test_check_judges_the_median_of_enough_cases(case, write, count, judged, capsys):
    """An error of 1e-5 is within the worst allowed in float, not within the median."""
    case["expect"] = {"tau": [float(value) * (1 + 1e-5) for value in case["expect"]["tau"]]}
    assert main(["check", write([case] * count), "--backend", "cf"]) == judged
    assert main(["check", write([case] * count), "--backend", "c"]) == 1


def test_check_counts_a_case_that_cannot_be_evaluated(case, write, capsys):
    case["q"][0] = "nan"
    assert main(["check", write([case]), "--backend", "casadi", "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert "status nonfinite" in answer["failures"][0]


@pytest.mark.parametrize("seed", [1992, 3])
def test_check_at_random_states(seed, capsys):
    assert main(["check", "--states", "20", "--seed", str(seed), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer["laws"]) == set(OUTPUTS)
    assert all(
        set(law) == {"c", "cf"} and set(law["c"]) == set(QUANTITIES) for law in answer["laws"].values()
    )


def test_random_check_sees_a_difference(monkeypatch, capsys):
    """The C of a law that is told a radius one part in a thousand too large."""
    from noslip.checks.verification import check

    def wrong(backend, law, params, config, gains):
        r = [quantity.name for quantity in law.parameters].index("r")
        params = [value * (1.001 if k == r and backend == "c" else 1) for k, value in enumerate(params)]
        return make_controller(backend, law, params, config, gains)

    monkeypatch.setattr(check, "make_controller", wrong)
    assert main(["check", "--states", "5", "--output", "type_i", "--backend", "c"]) == 1
    assert "type_i, c: Phi has an error of 1.0e-03" in capsys.readouterr().out


@pytest.mark.parametrize("off", [0.0, 0.1])
def test_random_check_leaves_out_what_rounding_the_state_changes_as_much(off, monkeypatch, capsys):
    """Beside the centre of an ellipse the first-order distance grows without bound, and so does its gradient;
    its rate is what is left of large terms. A difference that is larger than rounding explains is still
    one."""
    from noslip.checks.verification import check, sampling

    law = law_of(find_robot("labmate"), "type_iv_ellipse")
    numbers = [[q.default for q in group] for group in (law.parameters, law.config, law.gains)]
    model, reference = make_controller("casadi", law, *numbers), np.zeros(5)
    states = [np.array([3.0, 1.0, 0.4 + 0.01 * k, 0.0, 0.0, 3.0, 1.0]) for k in range(19)]
    by_right, by_left = model.evaluate(at := np.array([-0.05, -0.02, 0.4, 0, 0, 0, 0]), reference).values[
        "Phi"
    ][0]
    states.append(at + 10 * np.array([0, 0, 0, 0, 0, 1.0, -by_right / by_left]))
    points = [
        sampling.RandomPoint(k, x, reference, model.evaluate(x, reference)) for k, x in enumerate(states)
    ]
    monkeypatch.setattr(
        sampling, "random_plants", lambda *_: [sampling.RandomPlant(*map(tuple, (*numbers, points)))]
    )

    def shifted(backend, *given):
        made = make_controller(backend, *given)
        evaluate = made.evaluate
        more = off if backend == "cf" else 0.0
        made.evaluate = lambda *at: (
            (found := evaluate(*at))
            and replace(found, values=found.values | {"ydot": found.values["ydot"] + more})
        )
        return made

    monkeypatch.setattr(check, "make_controller", shifted)
    code = main(["check", "--states", "20", "--output", "type_iv_ellipse", "--backend", "cf", "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert (code, answer["ok"]) == ((1, False) if off else (0, True))
    assert [line.rpartition(",")[0] for line in answer["left_out"]] == (
        [] if off else ["type_iv_ellipse, cf: ydot in state 19"]
    )


# -- bad input -----------------------------------------------------------------------------------------------


def change(*path, value=None, delete=False):
    """A function that changes or deletes one place of a case."""

    def apply(case):
        for key in path[:-1]:
            case = case[key]
        if delete:
            del case[path[-1]]
        else:
            case[path[-1]] = value

    return apply


MALFORMED = {
    "missing q": (change("q", delete=True), "q missing"),
    "missing parameter": (change("params", "m_c", delete=True), "m_c missing"),
    "missing gain": (change("gains", "kd", delete=True), "kd_distance missing"),
    "missing L": (change("output", "L", delete=True), "L missing"),
    "missing radius": (change("output", "path", "R", delete=True), "R missing"),
    "missing ydd": (change("reference", "ydd", delete=True), "ydd missing"),
    "a rate in yd": (
        lambda case: case["reference"].update(yd=["0", "0.3"], ydd=["0", "0"]),
        "yd[1] = 0.3: speed has relative degree 1, and its desired rate is ydd[1]",
    ),
    "short q": (change("q", value=["0", "0"]), "list of 5 numbers"),
    "long nu": (change("nu", value=[1, 2, 3]), "list of 2 numbers"),
    "short y": (change("reference", "y", value=[1]), "list of 2 numbers"),
    "q no list": (change("q", value="1"), "list of 5 numbers"),
    "word": (change("nu", value=["fast", "1"]), '"fast" is not a number'),
    "underscore": (change("nu", value=["1_0", "1"]), "is not a number"),
    "boolean": (change("nu", value=[True, "1"]), "is not a number"),
    "null": (change("params", "r", value=None), "null is not a number"),
    "unknown type": (change("output", value={"type": "V", "L": 0}), "unknown output 'V'"),
    "type no text": (change("output", "type", value=4), "`type` is missing"),
    "unknown path": (change("output", "path", "kind", value="spiral"), "unknown output 'type_iv_spiral'"),
    "path no table": (change("output", "path", value="circle"), "output: path: must be an object"),
    "no path": (change("output", "path", delete=True), "requires a `path`"),
    "path of another type": (change("output", "type", value="I"), "takes no path of kind 'circle'"),
    "unknown parameter": (change("params", "mass", value="1"), "unknown key 'mass'"),
    "unknown gain": (change("gains", "ki", value="1"), "unknown gain 'ki'"),
    "unknown key": (change("expects", value={}), "did you mean 'expect'"),
    "unknown quantity": (change("expect", "tua", value=[1, 2]), "did you mean 'tau'"),
    "infinite expectation": (change("expect", "tau", value=["inf", "0"]), "not finite"),
    "ragged expectation": (change("expect", "Phi", value=[[1, 2], [3]]), "list of 2 numbers"),
    "params no table": (change("params", value=[1]), "must be an object"),
}


def test_the_rate_of_an_output_of_degree_1_is_ydd(tmp_path, monkeypatch, bad_input):
    """v = ydot_d + kv (y_d - y), computed here; the same number in yd is refused,
    as the law would not use it."""
    robot = Path(__file__).parents[1] / "robots_of_users.py"
    reference = {"y": [0.5, 0.2], "yd": [0, 0], "ydd": [0.3, -0.4]}
    one = {
        "params": {},
        "output": {"type": "speeds"},
        "q": [0.1, 0.2, 0.3],
        "nu": [0.7, 0.1],
        "gains": {"kv": 2.0},
    }
    cases = tmp_path / "cases.json"

    def write_with(reference):
        cases.write_text(json.dumps({"robot": f"{robot}:sled", "cases": [one | {"reference": reference}]}))

    write_with(reference)
    for backend in ("casadi", "c"):
        assert main(["evaluate", str(cases), "--backend", backend, "-o", str(tmp_path / "out.json")]) == 0
        (found,) = json.loads((tmp_path / "out.json").read_text())["cases"]
        np.testing.assert_allclose(found["u"], [0.3 + 2 * (0.5 - 0.7), -0.4 + 2 * (0.2 - 0.1)], atol=1e-13)
    write_with(reference | {"yd": [0.3, 0], "ydd": [0, -0.4]})
    assert "yd[0] = 0.3: forward has relative degree 1" in bad_input(["evaluate", str(cases), "-o", "-"])


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_case(case, write, tmp_path, bad_input, name):
    apply, says = MALFORMED[name]
    good = copy.deepcopy(case)
    apply(case)
    path = write([good, case])
    line = bad_input(["evaluate", path, "--backend", "casadi", "-o", str(tmp_path / "out.json")])
    assert f"{path}: case 1" in line and says in line


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not valid JSON, or truncated"),
        ('{"cases": [{"params": {"b": "0.75", "d', "not valid JSON, or truncated"),
        ("b = 0.75", "not valid JSON"),
        ("[]", "must be an object"),
        ("{}", "cases missing"),
        ('{"cases": []}', "at least one case"),
        ('{"cases": [7]}', "case 0: must be an object"),
        ('{"cases": [{}], "robots": "car"}', "did you mean 'robot'"),
        ('{"cases": [{}], "robot": 5}', "`robot` must be a name"),
        ('{"cases": [{}], "robot": "labmat"}', "did you mean 'labmate'"),
        ("[" * 100000, "nested too deep"),
        ('{"cases": [' + "1" * 5000 + "]}", "case 0: must be an object"),
    ],
)
@each_backend
def test_malformed_file(write, tmp_path, bad_input, text, says, backend):
    path = write(text)
    assert says in bad_input(["evaluate", path, "--backend", backend, "-o", str(tmp_path / "out.json")])


def test_file_that_is_no_text(tmp_path, bad_input):
    path = tmp_path / "cases.json"
    path.write_bytes(b"\xff\xfe\x00")
    assert "not UTF-8" in bad_input(["evaluate", str(path), "-o", str(tmp_path / "out.json")])


@pytest.mark.parametrize(
    ("source", "name", "says"),
    [
        ("def robot(:\n", "robot", "mine.py:1: SyntaxError"),
        ("\nimport no_such_module\n", "robot", "mine.py:2: ModuleNotFoundError"),
        ("def robot():\n    return 1 / 0\n", "robot", "mine.py:2: ZeroDivisionError"),
        (
            "from noslip.model import Mechanism\nrobot = Mechanism('my robot')\n",
            "robot",
            "mine.py:2: name 'my robot'",
        ),
        ("raise SystemExit(0)\n", "robot", "mine.py:1: SystemExit"),
        ("robot = 5\n", "robot", "neither a Mechanism"),
        (
            "from noslip.model.robots.labmate import labmate\nrobot = labmate()\n",
            "robto",
            "did you mean 'robot'",
        ),
    ],
)
def test_robot_file_with_an_error(case, write, tmp_path, bad_input, source, name, says):
    (tmp_path / "mine.py").write_text(source)
    path = write([case], robot=f"{tmp_path / 'mine.py'}:{name}")
    assert says in bad_input(["evaluate", path, "--backend", "casadi", "-o", str(tmp_path / "out.json")])


def test_files_that_cannot_be_read_or_written(case, write, tmp_path, bad_input):
    path = write([case])
    assert "nothing.json: No such file" in bad_input(["evaluate", str(tmp_path / "nothing.json")])
    assert "no_folder/out.json: the folder" in bad_input(
        ["evaluate", path, "--backend", "casadi", "-o", str(tmp_path / "no_folder/out.json")]
    )
    assert "is a folder; give a file in it" in bad_input(
        ["evaluate", path, "--backend", "casadi", "-o", str(tmp_path)]
    )
    assert "out.json: " in bad_input(["evaluate", path, "--backend", "casadi", "-o", f"{path}/out.json"])


def test_bad_input_leaves_the_old_output(case, write, tmp_path):
    out = tmp_path / "out.json"
    out.write_text("old")
    del case["q"]
    assert main(["evaluate", write([case]), "-o", str(out)]) == 2
    assert out.read_text() == "old"


def test_check_refuses(case, write, bad_input):
    wrong_shape = copy.deepcopy(case)
    wrong_shape["expect"]["Phi"] = [1, 2]
    assert "has shape [2]; it must be [2, 2]" in bad_input(
        ["check", write([wrong_shape]), "--backend", "casadi"]
    )
    del case["expect"]
    assert "nothing to compare" in bad_input(["check", write([case]), "--backend", "casadi"])
    assert "--seed applies to random states only" in bad_input(["check", write([case]), "--seed", "1"])
    assert "unknown output 'type_v'" in bad_input(["check", "--output", "type_v"])
    assert "unknown robot" in bad_input(["check", "--robot", "labmat"])
    assert "--states must be 1 to" in bad_input(["check", "--states", "0"])
    assert "casadi is the reference" in bad_input(["check", "--backend", "casadi"])


# -- close to the singular set -------------------------------------------------------------------------------


@cache
def determinant(law) -> ca.Function:
    """(parameters, config, states) to det Phi."""
    return ca.Function(
        "det",
        [symbols(group) for group in (law.parameters, law.config, law.state)],
        [law.linearization.determinant],
    )


def near_singular(law, plant, point, random):
    """The point's state with its heading turned to just beside where det Phi changes sign."""
    heading = [quantity.name for quantity in law.state].index("phi")

    def at(angle):
        states = np.tile(point.state[:, None], np.size(angle))
        states[heading] = angle
        return determinant(law)(plant.params, plant.config, states).full().ravel()

    # Not quarter turns, where det Phi may be exactly 0
    angles = point.state[heading] + 0.1 + np.linspace(0, 2 * np.pi, 33)
    values = at(angles)
    change = np.flatnonzero(values[:-1] * values[1:] < 0)[0]
    root = brentq(lambda angle: at(angle)[0], angles[change], angles[change + 1])
    state = point.state.copy()
    state[heading] = root + 10 ** random.uniform(-4, -1.5) * random.choice((-1, 1))
    return np.float32(state).astype(float)


@pytest.mark.parametrize("name", ["type_ii", "type_iii", "type_iv_line", "type_iv_circle", "type_iv_ellipse"])
def test_float_error_grows_no_faster_than_the_inverse_of_rcond(name):
    """u = Phi^-1 (...) in float: relative error times |det Phi| / product of row norms stays at a few
    roundings."""
    law, random = law_of(find_robot("labmate"), name), np.random.default_rng(11)
    conditions, errors = [], []
    for plant in random_plants(law, 400, seed=11):
        numbers = [
            np.float32(group).astype(float).tolist() for group in (plant.params, plant.config, plant.gains)
        ]
        double, single = (make_controller(backend, law, *numbers) for backend in ("c", "cf"))
        for point in plant.points:
            inputs = near_singular(law, plant, point, random), np.float32(point.reference).astype(float)
            exact, rounded = double.evaluate(*inputs), single.evaluate(*inputs)
            assert exact.status == rounded.status
            if exact.status == "singular":
                continue
            Phi, u = exact.values["Phi"], exact.values["u"]
            conditions.append(abs(np.linalg.det(Phi)) / np.prod(np.linalg.norm(Phi, axis=1)))
            errors.append(np.abs(rounded.values["u"] - u).max() / np.abs(u).max())
    conditions, errors = np.array(conditions), np.array(errors)
    roundings = errors * conditions / np.finfo(np.float32).eps
    assert len(roundings) > 200 and conditions.min() < 1e-3
    assert np.median(roundings) < 5 and roundings.max() < 500
    slope = np.polyfit(np.log10(conditions), np.log10(np.maximum(errors, 1e-9)), 1)[0]
    assert slope > -1.2


@pytest.mark.parametrize("name", OUTPUTS)
def test_many_random_states(name, capsys):
    assert main(["check", "--states", "2500", "--output", name]) == 0, capsys.readouterr().out
