"""`noslip analyse` and what it rests on: det Phi, normal forms, zero dynamics and starts,
against the robots' own numbers."""

import dataclasses
import json
import math
import re
import xml.dom.minidom

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from noslip.analysis.answers import _form, analyse, as_json, start_verdict, uncontrolled
from noslip.analysis.certification.safety import certify
from noslip.analysis.exact import functions
from noslip.analysis.outputs.decoupling import decouple
from noslip.analysis.outputs.normal_form import NormalForm, normal_form
from noslip.analysis.report import report
from noslip.analysis.text import WIDTH, as_text
from noslip.cli.main import main
from noslip.model import ModelError, OutputMap, OutputRow, linearize, reduce
from noslip.model.law import symbols
from noslip.model.outputs import OUTPUTS, at_point, body_point, forward_speed, output_map, type_iv
from noslip.model.paths import config, implicit, line
from noslip.model.rolling.contact import RollingContact
from noslip.model.rolling.surfaces import plane, sphere
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.spec import Initial, PathSection
from noslip.tests.codegen_tools import unicycle
from noslip.tests.reference import kinematic_systems
from noslip.tests.simulation.test_simulate import CIRCLE, SPECS, beside_line, changed

LAWS = tuple(OUTPUTS)
OFFSET_LAWS = ("type_i_offset", "type_iv_line_offset", "type_iv_circle_offset")
PATHS = tuple(law for law in LAWS if law.startswith("type_iv"))
AXLE, NORMAL = "P_l lies on the axle", "the heading is normal to the path"
NORMAL_OR_FLAT = f"{NORMAL}, or the gradient of the distance vanishes at P_l"  # implicit path


class Numbers:
    """The linearization behind a form at random states and parameters, by CasADi:
    nothing of the exact half is used."""

    def __init__(self, form: NormalForm):
        self.linearization, self.form = form.decoupling.linearization, form
        self.system = self.linearization.system
        self.x = ca.vertcat(self.system.mechanism.q, self.system.nu)
        self.fixed = symbols([*self.system.mechanism.parameters, *self.linearization.output.parameters])
        state = [s.name for s in self.system.state]
        fixed = [str(s) for s in form.decoupling.functions.symbols[: self.fixed.numel()]]
        self.names = [*state, *fixed]
        self.compiled = {}

    def states(self, count: int, seed: int = 5) -> np.ndarray:
        """Values of `names`: states of either sign, parameters about 1."""
        random = np.random.default_rng(seed)
        states = random.uniform(-2.0, 2.0, (count, self.x.numel()))
        return np.hstack([states, random.uniform(0.5, 2.0, (count, self.fixed.numel()))])

    def __call__(self, expression: ca.SX, at: np.ndarray) -> np.ndarray:
        n = self.x.numel()
        return ca.Function("f", [self.x, self.fixed], [ca.densify(expression)])(at[:n], at[n:]).full()

    def formula(self, text: str, at: np.ndarray) -> float:
        """A formula of the JSON."""
        if text not in self.compiled:
            names = {name: sp.Symbol(name) for name in self.names}
            self.compiled[text] = sp.lambdify(list(names.values()), sp.sympify(text, locals=names), "math")
        return float(self.compiled[text](*at))

    @property
    def driving(self) -> list[str]:
        """Names of the rates of rows of relative degree 2 and of the outputs of relative degree 1."""
        rows = zip(self.linearization.output.rows, self.linearization.relative_degree, strict=True)
        return [row.name if degree == 1 else f"{row.name}_dot" for row, degree in rows]

    def det(self, at: np.ndarray) -> float:
        return float(np.linalg.det(self(self.linearization.Phi, at)))

    def set(self, at: np.ndarray, **values: float) -> np.ndarray:
        moved = at.copy()
        for name, value in values.items():
            moved[self.names.index(name)] = value
        return moved

    def get(self, at: np.ndarray, *names: str) -> np.ndarray:
        return at[[self.names.index(name) for name in names]]


@pytest.fixture(scope="module")
def forms(answer) -> dict[str, NormalForm]:
    system = system_of(find_robot("labmate"))
    return answer.outputs | {
        law: normal_form(decouple(linearize(system, output_map(system, law)))) for law in OFFSET_LAWS
    }


@pytest.fixture(scope="module")
def answer():
    return analyse(find_robot("labmate"))


@pytest.fixture(scope="module")
def outputs(forms, answer) -> dict[str, dict]:
    """The outputs' part of the JSON."""
    return as_json(dataclasses.replace(answer, outputs=forms))["outputs"]


# -- det Phi -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS + OFFSET_LAWS)
def test_det_is_that_of_the_robots_own_phi(forms, outputs, law):
    numbers = Numbers(forms[law])
    for at in numbers.states(20):
        assert abs(numbers.formula(outputs[law]["det"], at) - numbers.det(at)) < 1e-11


def test_det_as_in_the_table_of_the_paper(forms, outputs):
    """Section 4 of the mathematics, typed from the table, with forward speed and signed distance."""
    c, s, l, k = "cos(phi)", "sin(phi)", "(L + d)", "r**2/(2*b)"  # noqa: E741
    rho = f"sqrt((x_c + L*{c} - x_f)**2 + (y_c + L*{s} - y_f)**2)"
    table = {
        "type_i": f"-{k}*{l}",
        "type_ii": f"-{k}*{c}",
        "type_iii": f"-{k}*{s}",
        "type_iv_line": f"{k}*{l}*(B*{c} - A*{s})/sqrt(A**2 + B**2)",
        "type_iv_circle": f"{k}*{l}*((y_c - y_f)*{c} - (x_c - x_f)*{s})/{rho}",
    }
    for law, expected in table.items():
        numbers = Numbers(forms[law])
        for at in numbers.states(20):
            assert abs(numbers.formula(outputs[law]["det"], at) - numbers.formula(expected, at)) < 1e-12


def test_det_is_written_in_factors(forms, outputs):
    """The lever is a factor; a gradient is written out where that is short,
    and told apart where it is not."""
    for law in ("type_i", *PATHS):
        det = forms[law].decoupling.det_for_people
        assert (
            any(str(part) in ("L + d", "-L - d") for part in sp.Mul.make_args(det))
            and sp.count_ops(det) <= 30
        )
    names = {law: {s.name for s in forms[law].decoupling.det_for_people.free_symbols} for law in PATHS}
    assert all(("n_x" in used) == (law in PATHS[2:]) for law, used in names.items())
    assert {"n_x", "n_y", "x_l", "y_l", "b_ellipse"} == set(outputs["type_iv_ellipse"]["where"])


@pytest.mark.parametrize("law", PATHS)
def test_the_short_det_is_the_long_one(forms, outputs, law):
    """With what `where` says about its symbols."""
    numbers, where = Numbers(forms[law]), outputs[law]["where"]
    names = {name: sp.Symbol(name) for name in (*numbers.names, *where)}
    short = sp.sympify(outputs[law]["det_short"], locals=names)
    for name in ("n_x", "n_y", "x_l", "y_l"):
        if name in where:
            short = short.subs(names[name], sp.sympify(where[name], locals=names))
    for at in numbers.states(10):
        values = dict(zip([names[name] for name in numbers.names], at, strict=True))
        assert abs(float(short.subs(values)) - numbers.det(at)) < 1e-11


# -- where it vanishes ---------------------------------------------------------------------------------------

WORDS = {
    "type_i": [AXLE],
    "type_ii": ["the heading is at 90 or -90 degrees, along the y axis"],
    "type_iii": ["the heading is at 0 or 180 degrees, along the x axis"],
    **{law: [AXLE, NORMAL] for law in PATHS},
    "type_iv_ellipse": [AXLE, NORMAL_OR_FLAT],
    "type_iv_circle_offset": ["the line from the middle of the axle to P_l is normal to the path"],
}


@pytest.mark.parametrize("law", WORDS)
def test_words(forms, law):
    conditions = forms[law].decoupling.conditions
    assert [c.words for c in conditions] == WORDS[law] and all(c.confirmed for c in conditions)


def heading_normal(numbers: Numbers, at: np.ndarray, arm: complex = 1.0) -> np.ndarray:
    """The same with P_l where it is, and the vehicle turned about it until `arm`, given in its frame,
    is along the gradient."""
    through = numbers.linearization.output.rows[0].through
    x_l, y_l = numbers(through.inner, at)[:, 0]
    gradient = ca.substitute(ca.gradient(through.outer, through.symbols), through.symbols, ca.DM([x_l, y_l]))
    n = complex(*numbers(gradient, at)[:, 0])
    phi = np.angle(n / arm)
    L, W = numbers.get(at, "L")[0], numbers.get(at, "W")[0] if "W" in numbers.names else 0.0
    centre = complex(x_l, y_l) - (L + 1j * W) * np.exp(1j * phi)
    return numbers.set(at, phi=phi, x_c=centre.real, y_c=centre.imag)


@pytest.mark.parametrize("law", LAWS + OFFSET_LAWS[1:])
def test_phi_is_singular_where_it_is_said(forms, law):
    numbers = Numbers(forms[law])
    for at in numbers.states(10):
        assert abs(numbers.det(at)) > 1e-4
        (d,) = numbers.get(at, "d")
        (L, W) = (numbers.get(at, "L")[0], numbers.get(at, "W")[0] if "W" in numbers.names else 0.0)
        for words in WORDS.get(law, WORDS["type_iv_circle_offset"]):
            there = {
                AXLE: lambda at, d=d: numbers.set(at, L=-d),
                NORMAL: lambda at: heading_normal(numbers, at),
                NORMAL_OR_FLAT: lambda at: heading_normal(numbers, at),
                WORDS["type_ii"][0]: lambda at: numbers.set(at, phi=-math.pi / 2),
                WORDS["type_iii"][0]: lambda at: numbers.set(at, phi=math.pi),
                WORDS["type_iv_circle_offset"][0]: lambda at, arm=L + d + 1j * W: heading_normal(
                    numbers, at, arm
                ),
            }[words](at)
            assert abs(numbers.det(there)) < 1e-13


def test_where_det_has_no_value(forms):
    """At the centre of a circle; on a line nowhere."""
    (centre,) = forms["type_iv_circle"].decoupling.undefined
    assert {str(s) for s in centre.free_symbols} == {"x_l", "y_l", "x_f", "y_f"}
    zero = centre.subs({s: 1.0 for s in centre.free_symbols})
    assert zero == 0 and not forms["type_iv_line"].decoupling.undefined


# -- normal form ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
def test_T_is_a_diffeomorphism_where_it_is_said(forms, outputs, law):
    """det J_T is +-minor det Phi, by differentiating T = (h, rates, h~) with CasADi."""
    form, numbers = forms[law], Numbers(forms[law])
    linearization, normal = numbers.linearization, form.decoupling.normal
    q = [c.name for c in numbers.system.mechanism.coordinates]
    for chart in form.charts[:2]:
        kept = ca.vertcat(*[numbers.system.mechanism.q[q.index(str(name))] for name in chart.kept])
        jacobian = ca.jacobian(ca.vertcat(linearization.h, linearization.rate, kept), numbers.x)
        assert jacobian.shape[0] == jacobian.shape[1]
        minor = form.decoupling.in_coordinates(form.decoupling.written_out(chart.minor))
        for at in numbers.states(10):
            expected = abs(numbers.formula(str(minor), at) * numbers.det(at))
            assert abs(abs(np.linalg.det(numbers(jacobian, at))) - expected) < 1e-10
    assert form.charts[0].everywhere == (normal is None)


@pytest.mark.parametrize("law", LAWS)
def test_what_moves_uncontrolled(forms, law):
    """z3' in closed form is S nu, whatever the state."""
    form, numbers = forms[law], Numbers(forms[law])
    linearization, q = numbers.linearization, [c.name for c in numbers.system.mechanism.coordinates]
    decoupling = form.decoupling
    assert list(form.equations) == [str(name) for name in form.charts[0].kept]
    parts = {
        (name, w): rate.coeff(sp.Symbol(w)) for name, rate in form.equations.items() for w in numbers.driving
    }
    parts = {key: str(decoupling.in_coordinates(decoupling.written_out(part))) for key, part in parts.items()}
    for at in numbers.states(10):
        own, h = numbers(numbers.system.qdot, at)[:, 0], numbers(linearization.h, at)[:, 0]
        speeds = iter(numbers(linearization.rate, at)[:, 0])
        w = [
            next(speeds) if degree == 2 else y
            for y, degree in zip(h, linearization.relative_degree, strict=True)
        ]
        for name in form.equations:
            rate = sum(
                numbers.formula(parts[name, k], at) * value
                for k, value in zip(numbers.driving, w, strict=True)
            )
            assert abs(rate - own[q.index(name)]) < 1e-9


def test_zero_dynamics(forms):
    """All relative degrees 2: m dimensions; with a degree 1 one more. All stand still."""
    assert [forms[law].dimension for law in ("type_i", "type_ii", "type_iii", *PATHS)] == [
        3,
        3,
        3,
        4,
        4,
        4,
        4,
    ]
    for law in LAWS:
        assert (
            forms[law].zero_dynamics == "z3' = 0"
            and forms[law].stability == "Lagrange stable, not asymptotically stable"
        )


def along_outputs(numbers: Numbers, expression: ca.SX, at: np.ndarray, rates: list[float]) -> float:
    """The rate of an expression in q when rates and speeds of the outputs are `rates`:
    q' = S Phi^-1 rates."""
    S, Phi = numbers(numbers.system.S, at), numbers(numbers.linearization.Phi, at)
    gradient = numbers(ca.jacobian(expression, numbers.system.mechanism.q), at)
    return float((gradient @ S @ np.linalg.solve(Phi, rates))[0])


@pytest.mark.parametrize("law", PATHS)
def test_the_heading_along_a_path(forms, law):
    """l s' = -V (s - l chi) on the robot's own equations, chi the curvature of the distance's level through
    P_l."""
    numbers, (moving,) = Numbers(forms[law]), forms[law].moving
    assert moving.stable_when == "V*(L + d) > 0" and str(moving.rate) == "-V/(L + d)"
    through = numbers.linearization.output.rows[0].through
    gradient = ca.gradient(through.outer, through.symbols)
    unit = gradient / ca.norm_2(gradient)
    bend = ca.trace(ca.jacobian(unit, through.symbols))
    inside = [ca.substitute(e, through.symbols, through.inner) for e in (unit, bend)]
    phi = numbers.system.mechanism.q[2]
    s = ca.dot(inside[0], ca.vertcat(ca.cos(phi), ca.sin(phi)))
    V = 0.7
    for at in numbers.states(20):
        lever = sum(numbers.get(at, "L", "d"))
        (s_0, chi) = (numbers(e, at)[0, 0] for e in (s, inside[1]))
        rate = along_outputs(numbers, s, at, [0.0, V])
        assert abs(lever * rate + V * (s_0 - lever * chi)) < 1e-9
        constant = forms[law].decoupling.normal.chi
        if constant is not None:
            h = numbers(numbers.linearization.h[0], at)[0, 0]
            on_path = numbers.formula(str(constant), at)
            assert abs(chi - on_path / (1 + on_path * h)) < 1e-10  # parallels have one centre


def test_a_constant_heading_error_stands_for_the_linearization(forms):
    """With P_l aside, about driving along a line: the derivative of the heading's rate by the heading is
    -V/(L + d)."""
    numbers, (moving,) = Numbers(forms["type_iv_line_offset"]), forms["type_iv_line_offset"].moving
    for at in numbers.states(5):
        A, B, V, step = *numbers.get(at, "A", "B"), 0.8, 1e-5
        along = math.atan2(-A, B)
        rates = [
            along_outputs(numbers, numbers.system.mechanism.q[2], numbers.set(at, phi=along + e), [0.0, V])
            for e in (-step, step)
        ]
        assert abs((rates[1] - rates[0]) / (2 * step) + V / sum(numbers.get(at, "L", "d"))) < 1e-6
        assert abs(sum(rates)) < 1e-6
    assert str(moving.rate) == "-V/(L + d)"


@pytest.mark.parametrize("law", ["type_i", "type_i_offset"])
def test_the_heading_behind_a_point(forms, law):
    """(L + d) phi' = V sin(psi - phi)."""
    numbers, (moving,) = Numbers(forms[law]), forms[law].moving
    assert moving.equation == "(L + d)*phi' = V*sin(psi - phi)" and moving.stable_when == "L + d > 0"
    for k, at in enumerate(numbers.states(10)):
        V, psi = 0.9, 0.7 * k
        rate = along_outputs(
            numbers, numbers.system.mechanism.q[2], at, [V * math.cos(psi), V * math.sin(psi)]
        )
        assert (
            abs(sum(numbers.get(at, "L", "d")) * rate - V * math.sin(psi - numbers.get(at, "phi")[0])) < 1e-10
        )


def test_a_held_heading_lets_the_other_coordinate_drift(forms):
    numbers, (moving,) = Numbers(forms["type_ii"]), forms["type_ii"].moving
    assert not moving.stable_when and "drifts" in moving.settles
    q, lookahead = numbers.system.mechanism.q, numbers.linearization.output.parameters[0].symbol
    y_l = q[1] + lookahead * ca.sin(q[2])
    for at in numbers.states(5):
        rate = along_outputs(numbers, y_l, at, [0.6, 0.0])
        assert abs(rate - 0.6 * math.tan(numbers.get(at, "phi")[0])) < 1e-10


# -- other robots and outputs --------------------------------------------------------------------------------


def form_of(system, output: OutputMap) -> NormalForm:
    return normal_form(decouple(linearize(system, output)))


def test_a_unicycle_has_its_point_on_the_axle():
    system = reduce(unicycle())
    form = form_of(system, output_map(system, "type_iv_line"))
    assert [str(c.formula) for c in form.decoupling.conditions][0] == "L" and form.moving[
        0
    ].stable_when == "L*V > 0"
    numbers = Numbers(form)
    for at in numbers.states(5):
        det = form.decoupling.det_in_full
        assert abs(numbers.formula(str(det), at) - numbers.det(at)) < 1e-12


def test_an_implicit_path_with_a_sine():
    """The wave's curvature is not constant: s follows it."""
    system = reduce(unicycle())
    s, w = config("s", 0.7, "m", "height", "positive"), config("w", 1.3, "m", "length", "positive")
    form = form_of(
        system,
        type_iv(system, implicit("wave", "wave", (s, w), lambda x, y: y - s.symbol * ca.sin(x / w.symbol))),
    )
    assert [c.words for c in form.decoupling.conditions] == [
        AXLE,
        NORMAL_OR_FLAT,
    ] and "follows L*chi" in form.moving[0].settles
    numbers = Numbers(form)
    for at in numbers.states(5):
        assert abs(numbers.formula(str(form.decoupling.det_in_full), at) - numbers.det(at)) < 1e-11


def test_distance_and_yaw_rate():
    """Another pairing: singular along the path; no rule for a moving reference is made up."""
    system = reduce(unicycle())
    path, point = line(), body_point()
    rows = (
        at_point(system, point, "distance", "distance", path.distance),
        OutputRow("turn", "rad/s", "yaw rate", system.nu[1]),
    )
    form = form_of(
        system, OutputMap("spin", "distance and yaw rate", rows, (*point, *path.parameters), (), path)
    )
    (condition,) = form.decoupling.conditions
    assert condition.words == "the heading is along the path" and condition.confirmed and form.moving == ()


def test_general_outputs_have_formulas():
    """x y and the heading; and a speed that does not vanish at rest, whose zero dynamics move."""
    system = reduce(unicycle())
    x, y, heading = ca.vertsplit(system.mechanism.q)
    form = form_of(
        system,
        OutputMap(
            "area",
            "x y and heading",
            (OutputRow("xy", "m^2", "x y", x * y), OutputRow("turn", "rad", "h", heading)),
        ),
    )
    numbers, conditions = Numbers(form), form.decoupling.conditions
    assert [c.words for c in conditions] == [""] and all(c.confirmed for c in conditions)
    for at in numbers.states(10):
        assert abs(numbers.formula(str(conditions[0].formula), at)) - abs(numbers.det(at)) < 1e-12
    drift = (
        OutputRow("a", "m/s", "speed and x", forward_speed(system) + x),
        OutputRow("b", "rad/s", "turn", system.nu[1]),
    )
    form = form_of(system, OutputMap("drift", "speeds", drift))
    assert (
        form.zero_dynamics == "x' = -x*cos(heading), y' = -x*sin(heading), heading' = 0"
        and form.stability == "not decided"
    )


def test_an_arm_has_three_quasi_velocities_and_no_types():
    analysis = analyse(unicycle("armed", arm=True))
    assert not analysis.outputs and analysis.no_outputs
    assert as_json(analysis)["outputs"] == {} and "Outputs: none" in as_text(analysis)


def test_names_of_robot_and_path_are_kept_apart(outputs):
    """The ellipse's half axis b is not the LABMATE's b."""
    ellipse = outputs["type_iv_ellipse"]
    assert "b_ellipse" in ellipse["det"] and "b of the output map" in ellipse["where"]["b_ellipse"]


# -- the command ---------------------------------------------------------------------------------------------


@pytest.fixture
def system_file(tmp_path):
    file = tmp_path / "systems.py"
    file.write_text(
        "import casadi as ca\n"
        "from noslip.model.rolling.contact import RollingContact\n"
        "from noslip.model.rolling.surfaces import ellipsoid, plane, sphere\n"
        "from noslip.tests.codegen_tools import unicycle\n"
        "from noslip.tests.reference.kinematic_systems import car, pendulum\n"
        "def ball(): return RollingContact(sphere(ca.SX.sym('R')), plane())\n"
        "def balls(): return RollingContact(sphere(1), sphere(1))\n"
        "egg = RollingContact(ellipsoid(3, 2, 1), plane())\n"
        "def broken(): raise ValueError('no')\n"
        "def three(): return 3\n"
    )
    return file


def ask(argv: list[str], capsys, code: int = 0) -> dict:
    capsys.readouterr()
    assert main(["analyse", *argv, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_json_of_the_labmate(capsys):
    data = ask(["labmate"], capsys)
    counts = [data[key] for key in ("coordinates", "constraints", "holonomic", "nonholonomic")]
    assert (
        counts == [5, 3, 1, 2] and data["growth"] == [2, 3, 4] and data["input_state_linearizable"] is False
    )
    (integral,) = data["integrals"]
    left, right = integral.split(" = ")
    difference = sp.sympify(f"{left} - ({right.removesuffix(' + const')})")
    names = {s.name: s for s in difference.free_symbols}
    ratio = sp.simplify(difference.diff(names["theta_r"]) / difference.diff(names["phi"]))
    assert sp.simplify(ratio + names["r"] / (2 * names["b"])) == 0
    assert tuple(data["outputs"]) == LAWS and data["refused"] == {} and data["starts"] == {}
    for law, output in data["outputs"].items():
        assert output["relative_degree"] == ([2, 1] if law in PATHS else [2, 2])
        assert all(
            isinstance(output[key], str) and output[key] for key in ("det", "singular_when", "zero_dynamics")
        )
    assert data["outputs"]["type_i"]["moving_reference"][0]["lever_default"] == pytest.approx(0.3)


def test_text_of_the_labmate(answer):
    written = as_text(answer)
    assert "3 in 5 coordinates, 1 holonomic, 2 nonholonomic" in written and "(2, 3, 4) of 5" in written
    assert (
        f"{NORMAL} (A*sin(phi) - B*cos(phi) = 0)" in written
        and "stable if and only if V*(L + d) > 0" in written
    )
    assert max(map(len, written.splitlines())) <= WIDTH and all(law in written for law in LAWS)


@pytest.mark.nightly
def test_kinematics_and_contacts_in_a_file(system_file, capsys):
    for name, growth, k in (
        ("car", [2, 3, 4], 0),
        ("pendulum", [2], 1),
        ("ball", [2, 3, 5], 0),
        ("balls", [2], 3),
        ("egg", [2, 3, 5], 0),
    ):
        data = ask([f"{system_file}:{name}"], capsys)
        assert (data["growth"], data["holonomic"], data["outputs"]) == (
            growth,
            k,
            {},
        ) and "no inputs" in data["no_outputs"]


def test_the_uncontrolled_coordinate_fits_the_line(forms):
    """On the line y = c (A = 0) it is x_c that moves freely: A, the derivative of the distance by x,
    vanishes there."""
    assert uncontrolled(forms["type_iv_line"]).startswith(
        "y_c, phi, theta_r, theta_l where A != 0, else x_c, phi, theta_r, theta_l:"
    )
    assert uncontrolled(forms["type_i"]).startswith("phi, theta_r, theta_l:")


def test_an_underactuated_robot_in_text_page_and_json(system_file, tmp_path, capsys):
    system_file.write_text("from noslip.tests.reference.kinematic_systems import snakeboard\n")
    page, robot = tmp_path / "page.html", f"{system_file}:snakeboard"
    assert main(["analyse", robot, "--report", str(page)]) == 0
    phrase = "the robot as driven by rotor_torque, wheel_torque alone, 2 of 3 quasi-velocities"
    for text in (capsys.readouterr().out, page.read_text()):
        assert phrase in text and "nu' = u" not in text and "8 of 8 dimensions" in " ".join(text.split())
    data = ask([robot], capsys)
    assert data["properties_of"] == phrase and data["input_state_linearizable"] is False
    verdicts = {c["name"]: c["verdict"] for c in data["checks"]}
    assert verdicts["controllable"] is True and verdicts["lagrange_stable"] is None
    assert all(place["verified"] for place in data["singular_places"])


@pytest.mark.nightly
def test_what_takes_too_much_is_not_decided(monkeypatch):
    """The bound is a number of terms, the same on every machine: of the constraints a line on stderr,
    of an output a reason."""
    reports: list[tuple[float, float, str]] = []
    robot = find_robot.__wrapped__("car")
    whole = analyse(robot, progress=lambda *report: reports.append(report))
    done = [
        count
        for count, total, of in reports
        if (total, of) == (functions.WORK, "terms at most for the constraints")
    ]
    assert whole.outputs and len(done) > 100 and done == sorted(done)
    monkeypatch.setattr(functions, "WORK", 1000)
    with pytest.raises(
        ModelError, match=r"^car: not decided within 1,000 terms of polynomials; write the system in simpler"
    ):
        analyse(find_robot.__wrapped__("car"))
    with pytest.raises(ModelError, match=r"not decided within 1,000 terms"):
        _form.__wrapped__(system_of(robot), "type_iv_circle")


def test_only_some_outputs(capsys):
    data = ask(["labmate", "--output", "type_iv_line_offset", "--output", "type_i"], capsys)
    assert list(data["outputs"]) == ["type_iv_line_offset", "type_i"]


@pytest.mark.nightly
def test_report_is_one_page(tmp_path, capsys, answer, start):
    page, out = tmp_path / "page.html", tmp_path / "answer.txt"
    assert (
        main(["analyse", "labmate", "--start", start("line.toml"), "--report", str(page), "-o", str(out)])
        == 0
    )
    assert capsys.readouterr().out == "" and "safe: " in out.read_text()
    written = page.read_text()
    assert not re.search(r"(src|href)=|@import|url\(", written) and written.count("http") == written.count(
        'xmlns="http://www.w3.org/2000/svg"'
    )
    formulas, drawings = (
        re.findall(rf"<{tag}[ >].*?</{tag}>", written, re.DOTALL) for tag in ("math", "svg")
    )
    for part in (*formulas, *drawings):
        xml.dom.minidom.parseString(part)
    assert len(drawings) == 2 and all(
        f">{name}</text>" in drawings[0] for name in ("s1", "[s1,[s1,s2]]", "holonomic")
    )
    assert all(f"<code>{law}</code>" in written for law in LAWS)


def test_report_of_what_has_no_outputs():
    contact = RollingContact(sphere(ca.SX.sym("R")), plane())
    for system, phrase in (
        (kinematic_systems.pendulum(), "1 holonomic, 0 nonholonomic"),
        (contact, "both Gaussian curvatures"),
    ):
        assert phrase in report(analyse(system))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["labmat"], "did you mean 'labmate'"),
        (["labmate", "--output", "type_v"], "unknown output 'type_v'"),
        (["labmate", "--start", "none.toml"], "none.toml"),
        (["{file}:nothing"], "it does not define a robot 'nothing'"),
        (["{file}:three"], "neither a Mechanism"),
        (["{file}:broken"], "ValueError: no"),
        (["{file}:car", "--output", "type_i"], "no inputs"),
        (["{file}:unicycle", "--start", str(SPECS / "line.toml")], "is not unicycle"),
        (["labmate", "--report", "{folder}/none/page.html"], "does not exist"),
    ],
)
def test_bad_input(bad_input, system_file, arguments, message):
    filled = [argument.format(file=system_file, folder=system_file.parent) for argument in arguments]
    assert message in bad_input(["analyse", *filled])


# -- starts --------------------------------------------------------------------------------------------------

START = """robot = "labmate"
gains = {{ kp = 1.0, kd = 2.5, kv = 2.0 }}
output = {{ type = "IV", path = {{ kind = "line", A = 1, B = -1, C = 0 }} }}
reference = {{ speed = {speed} }}
initial = {{ point = [0.0, {y}], heading = {heading}, speed = {speed} }}
simulation = {{ duration = 3.0, period = {period} }}
"""


@pytest.fixture
def start(tmp_path):
    def start(
        name: str,
        offset: float = 1.0,
        heading: float = math.pi / 4,
        period: float = 0.0,
        speed: float = 1.414,
    ) -> str:
        file = tmp_path / name
        file.write_text(START.format(y=offset * math.sqrt(2), heading=heading, period=period, speed=speed))
        return str(file)

    return start


@pytest.mark.nightly
def test_starts_on_the_command_line(start, capsys, bad_input):
    safe, wide, sampled = start("safe.toml"), start("wide.toml", 5.0), start("sampled.toml", period=0.01)
    starts = ask(["labmate", "--output", "type_i", "--start", safe, "--start", sampled], capsys)["starts"]
    for file in (safe, sampled):
        assert (
            starts[file]["verdict"] == "safe" and starts[file]["t"] is None and 0 < starts[file]["margin"] < 1
        )
    data = ask(["labmate", "--output", "type_i", "--start", wide], capsys, code=1)
    assert (
        data["verdict"] == "singular"
        and abs(data["t"] - 0.845) < 1e-3
        and data["starts"][wide]["t"] == data["t"]
    )
    assert (
        main(["analyse", "labmate", "--start", wide]) == 1 and "will be singular: " in capsys.readouterr().out
    )
    assert "singular at the start" in bad_input(
        ["analyse", "labmate", "--start", start("normal.toml", heading=-math.pi / 4)]
    )


def same_times(*courses: np.ndarray) -> list[np.ndarray]:
    """s of each course, t and s, at the times that they have in common, which are more than 10."""
    ticks = [np.round(course[0] / 1e-9).astype(np.int64) for course in courses]
    common = np.intersect1d(*ticks)
    assert len(common) > 10
    return [course[1][np.searchsorted(tick, common)] for course, tick in zip(courses, ticks, strict=True)]


# On the circle of CIRCLE, leftwards
ARC = {"x_s": 30.0, "y_s": 20.0, "direction": math.pi / 2, "curvature": 0.1}


@pytest.mark.nightly
@pytest.mark.parametrize("heading", np.radians([-60, -40, 0, 90, 120, 150]))
def test_an_arc_is_judged_as_its_circle_and_as_it_runs(heading):
    """The arc's normal points to the left, the circle's outwards; h1 and s only change their signs."""
    simulation = {"duration": 2.0, "output_step": 0.05, "backend": "casadi"}
    round_ = changed(CIRCLE, initial={"heading": float(heading)}, simulation=simulation)
    arc = changed(round_, output={"path": PathSection(kind="segment", parameters=ARC)})
    verdicts = [certify(make_loop(spec), spec) for spec in (round_, arc)]
    assert verdicts[0].kind == verdicts[1].kind
    assert np.abs(np.add(*same_times(verdicts[0].course, verdicts[1].course))).max() < 1e-6
    run = simulate(arc)
    assert verdicts[1].kind == ("singular" if run.stopped else "safe")
    if run.stopped:
        assert abs(verdicts[1].t - run.t[-1]) < 1e-3


@pytest.mark.parametrize(("offset", "kind"), [(1.0, "safe"), (5.0, "singular")])
def test_reversing_with_the_point_behind_is_driving_forward_with_it_ahead(offset, kind):
    """Turned by 180 degrees, with v and L + d negated, everything is the same."""
    forward = changed(beside_line(offset, 1.414), simulation={"duration": 2.0})
    initial = Initial(point=forward.initial.point, heading=math.pi / 4 + math.pi, speed=-1.414)
    back = changed(forward, output={"L": -0.6}, reference={"speed": -1.414}, initial=initial)
    verdicts = [certify(make_loop(spec), spec) for spec in (forward, back)]
    assert [v.kind for v in verdicts] == [kind, kind]
    assert np.abs(np.add(*same_times(verdicts[0].course, verdicts[1].course))).max() < 1e-6
    run = simulate(changed(back, simulation={"output_step": 0.05, "backend": "casadi"}))
    assert bool(run.stopped) == (kind == "singular")


def test_an_equilibrium_that_is_not_stable_is_called_so(start):
    """On the path and along it with L + d behind the axle's side: nothing moves,
    but nothing holds it there either."""
    file = start("reverse.toml", offset=0.0, speed=-1.414)
    verdict = start_verdict("labmate", file)
    assert verdict.kind == "unstable equilibrium" and verdict.t is None
    turned = start_verdict(
        "labmate", start("turned.toml", offset=0.0, heading=math.pi / 4 + 0.01, speed=-1.414)
    )
    assert turned.kind == "singular" and turned.t > 0.5


@pytest.mark.nightly
def test_a_course_is_what_the_run_does():
    spec = beside_line(1.0, 1.414)
    verdict, run = (
        certify(make_loop(spec), spec),
        simulate(changed(spec, simulation={"backend": "casadi", "duration": 2.0})),
    )
    normal = np.array([1.0, -1.0]) / math.sqrt(2)
    s = np.cos(run.q[:, 2]) * normal[0] + np.sin(run.q[:, 2]) * normal[1]
    assert np.abs(np.subtract(*same_times(verdict.course, np.array([run.t, s])))).max() < 1e-6


@pytest.mark.nightly
def test_texts_of_verdicts():
    circle = changed(CIRCLE, simulation={"duration": 2.0})
    assert str(certify(make_loop(circle), circle)).startswith("safe: |s| stays below 0.18")
    offset = changed(circle, output={"W": 0.2})
    assert certify(make_loop(offset), offset).kind == "safe"


CASTORS = """
from casadi import cos, sin
from noslip.model import Mechanism

robot = Mechanism("castors", "a platform with two driven wheels and two castors")
x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
right, left = robot.coordinate("right", "rad"), robot.coordinate("left", "rad")
turns = [robot.coordinate(f"turn_{k}", "rad") for k in (1, 2)]
rolls = [robot.coordinate(f"roll_{k}", "rad") for k in (1, 2)]
m, I = robot.parameter("m", 30.0, "kg"), robot.parameter("I", 5.0, "kg m^2")
J = robot.parameter("J", 0.01, "kg m^2")
b, r, e, r_c = (robot.parameter(name, value, "m") for name, value in (("b", 0.3), ("r", 0.1), ("e", 0.04),
    ("r_c", 0.05)))
ahead, aside = robot.parameter("ahead", 0.5, "m"), robot.parameter("aside", 0.2, "m")
I_k = robot.parameter("I_k", 0.002, "kg m^2")

def along(velocity, angle):
    across = velocity[1] * cos(angle) - velocity[0] * sin(angle)
    return velocity[0] * cos(angle) + velocity[1] * sin(angle), across

rate = robot.rate
forward, sideways = along((rate(x), rate(y)), phi)
turning = I * rate(phi) ** 2 + J * (rate(right) ** 2 + rate(left) ** 2)
robot.kinetic_energy((m * (forward**2 + sideways**2) + turning) / 2)
robot.rolls("no side slip", sideways)
robot.rolls("right wheel", forward + b * rate(phi) - r * rate(right))
robot.rolls("left wheel", forward - b * rate(phi) - r * rate(left))
for k, (turn, roll, side) in enumerate(zip(turns, rolls, (1, -1))):
    angle = phi + turn
    place = (
        x + ahead * cos(phi) - side * aside * sin(phi) - e * cos(angle),
        y + ahead * sin(phi) + side * aside * cos(phi) - e * sin(angle),
    )
    ahead_of_wheel, across_wheel = along((rate(place[0]), rate(place[1])), angle)
    robot.kinetic_energy(I_k * ((rate(phi) + rate(turn)) ** 2 + rate(roll) ** 2) / 2)
    robot.rolls(f"castor {k + 1} sideways", across_wheel)
    robot.rolls(f"castor {k + 1} rolls", ahead_of_wheel - r_c * rate(roll))
robot.input("tau_r", "N m", on=rate(right))
robot.input("tau_l", "N m", on=rate(left))
robot.quasi_velocity("v", "m/s", forward)
robot.quasi_velocity("omega", "rad/s", rate(phi))
robot.moves_in_plane(x, y, phi)
"""


@pytest.mark.nightly
def test_castors_that_are_modelled_change_what_is_reached_not_the_outputs(tmp_path, capsys):
    """Nine coordinates, seven constraints: only the heading by the wheels' angles is an integral, as for the
    platform alone, and Types I to IV are those of a unicycle."""
    (tmp_path / "castors.py").write_text(CASTORS)
    assert main(["analyse", f"{tmp_path / 'castors.py'}:robot", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["constraints"], found["holonomic"], found["nonholonomic"]) == (7, 1, 6)
    assert found["growth"][0] == 2 and found["growth"][-1] == 8
    assert {name: found["outputs"][name]["relative_degree"] for name in ("type_i", "type_iv_line")} == {
        "type_i": [2, 2],
        "type_iv_line": [2, 1],
    }
