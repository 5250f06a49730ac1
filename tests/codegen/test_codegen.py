"""From expressions to C text: graph, passes, steps, printing,
files. Values are compared with evaluations of the graph."""

import functools
import itertools
import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import cffi
import mpmath
import noslip
import numpy as np
import pytest
from noslip.checks.verification.sampling import random_plants
from noslip.cli.main import main
from noslip.codegen import files as codegen_files
from noslip.codegen import program as program_module
from noslip.codegen.costs import cycles
from noslip.codegen.derivation.stages import inner_velocities
from noslip.codegen.derivation.taylor import Taylor
from noslip.codegen.files import law_program, law_text, robot_files, text_files
from noslip.codegen.graph import (
    Applied,
    Constant,
    Graph,
    Leaf,
    Operation,
    count,
    executed,
    from_casadi,
    is_constant,
    reachable,
)
from noslip.codegen.identity import fingerprint
from noslip.codegen.optimize import PASSES, Optimizer
from noslip.codegen.printing.meaning import meanings
from noslip.codegen.printing.scalar import DOUBLE, FLOAT, SCALARS
from noslip.codegen.printing.statements import Statements
from noslip.codegen.program import compile_law
from noslip.model import ModelError, OutputMap, OutputRow, control_law, reduce
from noslip.model.algebra import entries, exact
from noslip.model.law import ControlLaw
from noslip.model.outputs import OUTPUTS, type_i, type_iv
from noslip.model.paths import PATHS, implicit
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.simulation.controllers.build import shared_library
from noslip.simulation.controllers.compiled import CompiledController, library
from noslip.simulation.controllers.symbolic import CasadiController
from noslip.tests.codegen_tools import (
    NAMES,
    evaluate,
    in_c,
    laws,
    random_leaves,
    relative_error,
    unicycle,
    with_foot,
)

ROOT = Path(noslip.__file__).parent
SHIPPED = ROOT / "generated"
EXACT = 1e-30  # relative, of evaluations with 50 digits
NUMPY = {"double": np.float64, "float": np.float32}
GROUPS = ("params", "config", "gains", "state", "reference")

each_law = pytest.mark.parametrize("name", NAMES)
each_labmate_law = pytest.mark.parametrize("name", list(OUTPUTS))
each_scalar = pytest.mark.parametrize("scalar", list(SCALARS))


@cache
def compiled(name: str, optimize: bool = True):
    return compile_law(laws()[name], optimize)


# -- graph ---------------------------------------------------------------------------------------------------


def test_equal_expressions_are_one_node():
    graph = Graph()
    x, y = graph.leaf("state", "x"), graph.leaf("state", "y")
    assert graph.leaf("state", "x") is x and graph.leaf("params", "x") is not x
    assert graph.constant(2) is graph.constant(2.0) and graph.constant(-0.0) is graph.constant(0.0)
    assert graph.apply(Operation.ADD, x, y) is graph.apply(Operation.ADD, y, x)
    assert graph.apply(Operation.MUL, x, y) is graph.apply(Operation.MUL, y, x)
    assert graph.apply(Operation.SUB, x, y) is not graph.apply(Operation.SUB, y, x)
    assert all(
        a.order < node.order for node in reachable([graph.apply(Operation.DIV, x, y)]) for a in node.arguments
    )


def random_graph(seed: int, size: int = 25):
    """A graph of `size` operations, few of them used once, and its last nodes as roots."""
    source, graph = random.Random(seed), Graph()
    nodes = [graph.leaf(group, f"{group[0]}{k}") for group in GROUPS for k in range(3)]
    nodes += [graph.constant(c) for c in (0, 1, -1, 2, 0.5, -0.25, 3, 0.1)]
    for _ in range(size):
        operation = Operation(
            source.choice(["add", "sub", "mul"] * 6 + ["div", "neg"] * 3 + ["sqrt", "sin", "cos", "abs"])
        )
        a, b = (source.choice(nodes[-12:] if source.random() < 0.7 else nodes) for _ in range(2))
        if operation in ("sin", "cos"):  # CasADi leaves no sine of a number
            a = graph.apply(Operation.ADD, graph.apply(Operation.MUL, a, nodes[0]), nodes[9])
        if operation == "sqrt":
            a = graph.apply(Operation.ABS, a)
        if operation == "div":  # away from zero, and not always a sum
            positive = graph.apply(Operation.ADD, graph.constant(3), graph.apply(Operation.ABS, b))
            b = positive if source.random() < 0.5 else source.choice(nodes[:15])
        nodes.append(graph.apply(operation, *((a, b) if operation in ("add", "sub", "mul", "div") else (a,))))
    return graph, nodes[-6:]


@pytest.mark.parametrize("scalar", [np.float32, np.float64])
def test_simplifying_keeps_every_bit(scalar):
    """apply against make, which never simplifies, over every pair of small expressions;
    rounded arithmetic."""
    graph, source = Graph(), random.Random(1)
    x, y = graph.leaf("state", "x"), graph.leaf("state", "y")
    numbers = [graph.constant(c) for c in (0, 1, -1, 2, -0.5, 0.125, 3, -0.1)]
    small = [x, y, *numbers]
    small += [graph.make(Applied, (a,), Operation.NEG) for a in (x, y)]
    small += [graph.make(Applied, (x, y), operation) for operation in (Operation.SUB, Operation.MUL)]
    small += [graph.make(Applied, (a,), Operation.NEG) for a in small[-2:]]
    functions = in_c(scalar, lambda angle: (np.sin(angle), np.cos(angle)))
    for operation in map(Operation, ("add", "sub", "mul", "div", "neg", "abs", "sin", "cos")):
        two = operation in ("add", "sub", "mul", "div")
        for arguments in [(a, b) for a in small for b in small] if two else [(a,) for a in small]:
            if operation == "div" and is_constant(arguments[1], 0):
                continue
            leaves = {n: scalar(source.uniform(-2, 2)) for n in (x, y)}
            simple = graph.apply(operation, *arguments)
            with np.errstate(all="ignore"):
                a, b = evaluate(
                    [simple, graph.make(Applied, arguments, operation)], leaves.__getitem__, scalar, functions
                )
            assert a == b, (operation, arguments)


# -- passes --------------------------------------------------------------------------------------------------


TURNS = 100  # more than any law needs


class Checked(Optimizer):
    """An Optimizer that compares the roots' values before and after each of its passes,
    and does not turn for ever."""

    seen: set[str] = set()
    leaf = staticmethod(random_leaves(7))

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.turns = 0

    def _to_turn(self, signed, tried):
        self.turns += 1
        assert self.turns < TURNS, "differences are turned round and round"
        return super()._to_turn(signed, tried)

    def passes(self, roots):
        before = evaluate(roots, self.leaf)
        for name, improved in super().passes(roots):
            for after, value in zip(evaluate(improved, self.leaf), before, strict=True):
                assert abs(after - value) <= EXACT * max(abs(value), 1e-15), name
            self.seen.add(name)
            yield name, improved


@pytest.mark.parametrize("seed", range(8))
def test_passes_keep_the_value_of_random_graphs(seed):
    tried = 0
    for k in range(40):
        graph, roots = random_graph(1000 * seed + k)
        try:
            values = evaluate(roots, Checked.leaf)
        except ZeroDivisionError:
            continue
        if max(map(abs, values)) > 1e15:  # what is left of 50 digits would not be enough
            continue
        tried += 1
        named = reachable(roots)[::3]
        truth = dict(zip([f"n{node.order}" for node in named], evaluate(named, Checked.leaf), strict=True))
        labels = {node: f"n{node.order}" for node in named}
        final = Checked(graph, labels).run(roots)
        assert {type(node) for node in reachable(final)} <= {Constant, Leaf, Applied}
        kept = [node for node in reachable(final) if node in labels]
        for node, value in zip(kept, evaluate(kept, Checked.leaf), strict=True):
            assert abs(value - truth[labels[node]]) <= EXACT * max(abs(value), 1e-15), (
                "a name moved to another value"
            )
    assert tried >= 20


def test_a_quotient_in_a_quotient_is_one_division():
    """k (a v + w + b / c) / d, and the same in two terms with factors in common."""
    graph = Graph()
    a, b, c, d, v, w = (graph.leaf("state", name) for name in "abcdvw")
    k = graph.leaf("params", "k")
    add, mul, div = (
        functools.partial(graph.apply, operation)
        for operation in (Operation.ADD, Operation.MUL, Operation.DIV)
    )
    one = div(mul(k, add(add(mul(a, v), w), div(b, c))), d)
    two = add(div(mul(k, mul(a, v)), d), div(mul(k, add(w, div(b, c))), d))
    squared = div(add(mul(mul(v, v), w), mul(v, div(b, c))), d)  # v twice in one term, once in the other
    for root in (one, two, squared):
        values = {node: mpmath.mpf(place + 2) / 7 for place, node in enumerate((a, b, c, d, v, w, k))}
        (made,) = Optimizer(graph, {}).run([root])
        assert count(reachable([made]))[Operation.DIV] == 1
        assert abs(evaluate([made], values.__getitem__)[0] - evaluate([root], values.__getitem__)[0]) <= EXACT


def test_a_kept_product_is_not_split():
    """p = k y in p p + w, p z + w and p + w: one product for each p if p is kept,
    else one more for k^2 y y."""
    graph = Graph()
    k, (y, z, w) = graph.leaf("params", "k"), (graph.leaf("state", name) for name in "yzw")
    add, mul = (functools.partial(graph.apply, operation) for operation in (Operation.ADD, Operation.MUL))
    p = mul(k, y)
    roots = [add(mul(p, p), w), add(mul(p, z), w), add(p, w)]
    leaf = {
        k: mpmath.mpf(2) / 7,
        y: mpmath.mpf(3) / 7,
        z: mpmath.mpf(5) / 7,
        w: mpmath.mpf(-4) / 7,
    }.__getitem__
    products = {}
    for kept in (frozenset(), frozenset([p])):
        made = Optimizer(graph, {}, kept=kept).run(roots)
        products[kept] = count(executed(made))[Operation.MUL]
        assert relative_error(evaluate(made, leaf), evaluate(roots, leaf)) <= EXACT
    assert list(products.values()) == [4, 3]


CONICS = {
    "circle": lambda x, y: x**2 + y**2 - 9,
    "ellipse": lambda x, y: x**2 / 16 + y**2 / 4 - 1,
    "turned": lambda x, y: (x**2 + x * y + 3 * y**2 - 4) / 2,
    "hyperbola": lambda x, y: 4 - x**2 + 3 * y**2,
    "lines": lambda x, y: 2 * y**2 - 1,
    "elsewhere": lambda x, y: ((x - 1) ** 2 + 4 * (y - 2) ** 2 - 9) / 2,
    "parabola": lambda x, y: y - x**2,
}


@pytest.mark.parametrize("name", CONICS)
def test_conics(name):
    """Laws of implicit conics, about the origin and elsewhere, are those that the model writes."""
    system = system_of(find_robot("labmate"))
    law = control_law(system, type_iv(system, implicit(name, name, (), CONICS[name])))
    short, plain = compile_law(law), compile_law(law, optimize=False)
    for entry, body in short.entries.items():
        for quantity, matrix in body.quantities.items():
            values, expected = (
                [n for row in m for n in row] for m in (matrix, plain.entries[entry].quantities[quantity])
            )
            for seed in range(2):
                assert (
                    relative_error(
                        evaluate(values, random_leaves(seed)), evaluate(expected, random_leaves(seed))
                    )
                    <= EXACT
                )


@each_law
def test_passes_keep_the_value_of_laws(name, monkeypatch):
    monkeypatch.setattr(program_module, "Optimizer", Checked)
    monkeypatch.setattr(Checked, "seen", set())
    compile_law(laws()[name])
    assert Checked.seen > {name for name, _ in PASSES}


@each_law
def test_steps_are_the_law(name):
    """The cheap frame, the steps and all passes against the law as the model writes it."""
    plain = compiled(name, optimize=False)
    assert list(plain.entries) == list(compiled(name).entries)
    for seed in range(3):
        leaf = random_leaves(seed)
        for entry, body in compiled(name).entries.items():
            truth = plain.entries[entry]
            assert body.quantities.keys() == truth.quantities.keys()
            for quantity, matrix in body.quantities.items():
                assert [len(row) for row in matrix] == [len(row) for row in truth.quantities[quantity]]
                values, expected = (
                    [n for row in m for n in row] for m in (matrix, truth.quantities[quantity])
                )
                assert relative_error(evaluate(values, leaf), evaluate(expected, leaf)) <= EXACT, (
                    entry.name,
                    quantity,
                )


@pytest.mark.parametrize("name", ["type_iv_segment", "type_iv_segment_offset"])
def test_the_foot_is_enough(name):
    """At the foot of P_l the torques and their slope are those at the pose,
    on arcs to the left and to the right."""
    law = law_of(find_robot("labmate"), name)
    programs = compile_law(law), compile_law(law, optimize=False)
    ours, truth = (
        {entry.name: body.quantities for entry, body in program.entries.items()} for program in programs
    )
    for seed in range(6):
        leaf, turns = random_leaves(seed), -1 if seed % 2 else 1

        def turned(node: Leaf, leaf=leaf, turns=turns):
            return leaf(node) * (turns if node.name == "curvature" else 1)

        bent = with_foot(turned, offset=name.endswith("_offset"))
        for told, posed, quantity in (("follow", "step", "tau"), ("follow_slope", "slope", "slope")):
            found, plain, expected = (
                evaluate([n for row in body[quantity] for n in row], bent)
                for body in (ours[told], truth[told], truth[posed])
            )
            assert relative_error(found, expected) <= EXACT >= relative_error(plain, expected), (seed, told)


@each_law
def test_singular_is_where_the_law_says(name):
    """Near the boundary, in exact arithmetic: the cheap condition holds where the plain one does."""
    plain, singular = compiled(name, optimize=False), []
    entries = [entry for entry in compiled(name).entries if entry.inverts]
    sources = {
        entry.name: (compiled(name).entries[entry].singular, plain.entries[entry].singular)
        for entry in entries
    }
    Phi = next(body.quantities["Phi"] for entry, body in plain.entries.items() if entry.name == "evaluate")
    for seed in range(4):
        there, at = singular_place(Phi, random_leaves(seed))
        near = random.Random(seed)
        for _ in range(25):
            leaf = at(there + near.choice((-1, 1)) * mpmath.mpf(10) ** near.uniform(-9, -1))
            for ours, truth in sources.values():
                (square, bound), (square_0, bound_0) = evaluate(ours, leaf), evaluate(truth, leaf)
                assert (square > bound) == (square_0 > bound_0)
                singular.append(square <= bound)
    assert 0.2 < np.mean(singular) < 0.95


def test_cycles_of_a_small_graph():
    """By hand: a product, a sum that waits for it, a division that does not, the root of it; four loads."""
    graph = Graph()
    a, b, c, d = (graph.leaf("state", name) for name in "abcd")
    sum_ = graph.apply(Operation.ADD, graph.apply(Operation.MUL, a, b), c)
    root = graph.apply(Operation.SQRT, graph.apply(Operation.DIV, c, d))
    assert cycles([sum_, root]) == 1 + (1 + 1) + 14 + (14 + 1) + 4 * 1.5


def test_what_is_printed_or_compiled_is_in_the_key(monkeypatch):
    """A law that differs from a cached one in one text, name, condition or factor has other keys;
    the same law again the same."""
    system = reduce(unicycle())
    output, program = (
        type_iv(system, PATHS["segment"]()),
        compile_law(control_law(system, type_i(system)), optimize=False),
    )
    (first, *others), length = output.rows, output.parameters[0].symbol
    chain = first.through
    assert chain and chain.slope is not None and chain.bend is not None

    def rows(**changes) -> OutputMap:
        return replace(output, rows=(replace(first, **changes), *others))

    changed = {
        "nothing": output,
        "about": replace(output, about="NEWTEXT"),
        "name": replace(output, name="another"),
        "name of a row": rows(name="yy"),
        "unit": rows(unit="mm"),
        "about of a row": rows(about="NEWTEXT"),
        "condition": replace(output, conditions=((length, "ahead"),)),
        "another condition": replace(output, conditions=((length + 1, "ahead"),)),
        "slope": rows(through=replace(chain, slope=2 * chain.slope)),
        "bend": rows(through=replace(chain, bend=chain.bend + 1)),
        "no path": replace(output, path=None),
        "kinematic": replace(output, kinematic=True),
    }
    changed_laws = {what: control_law(system, other) for what, other in changed.items()}
    changed_laws["slope of the law"] = replace(law := control_law(system, output), tau_of_v=2 * law.tau_of_v)
    keys: list[tuple] = []
    monkeypatch.setattr(codegen_files, "remembered", lambda key, make, *shared: keys.append(key))

    def keys_of(law: ControlLaw) -> tuple[tuple, ...]:
        keys.clear()
        law_program(law)
        text_files(law_text(replace(program, law=law), DOUBLE))
        return tuple(keys)

    seen = {what: keys_of(law) for what, law in changed_laws.items()}
    for of_program_or_text in zip(*seen.values(), strict=True):
        assert len(set(of_program_or_text)) == len(changed_laws), seen
    assert keys_of(control_law(system, output)) == seen["nothing"]


def test_a_changed_text_is_written(monkeypatch, tmp_path):
    """After the law with the old text has been written from the same cache."""
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path))
    system = reduce(unicycle())
    for about in ("OLDTEXT", "NEWTEXT"):
        law = control_law(system, replace(type_i(system), about=about))
        for text in text_files(law_text(law_program(law), DOUBLE)).values():
            assert set(re.findall("OLDTEXT|NEWTEXT", text)) == {about}


def test_for_a_target_is_refused(tmp_path, bad_input):
    assert "leave it out" in bad_input(["generate", "labmate", "--for", "rv32", "-o", str(tmp_path)])


@each_scalar
def test_what_init_bounds_is_not_tested_at_each_step(scalar):
    """P_l nearer and nearer to the axle, Type I: the status of the model,
    with and without a test at each step."""
    law, seen, number = law_of(find_robot("labmate"), "type_i"), set(), NUMPY[scalar]
    params, gains = ([float(number(q.default)) for q in group] for group in (law.parameters, law.gains))
    b, d = (params[[q.name for q in law.parameters].index(name)] for name in "bd")
    for ratio in (1.0, 1e-1, 1e-3, 1e-4, 3e-5, 1.3e-5, 7.5e-6, 3.5e-6, 1e-6, 1e-7):
        config = [float(number(ratio * b - d))]
        ours = CompiledController(law, params, config, gains, made_by=library(law, scalar))
        truth = CasadiController(law, params, config, gains)
        for angle in np.linspace(-np.pi, np.pi, 17):
            at = np.array([0.1, 0.2, number(angle), 0.0, 0.0, 1.0, 1.5]), np.zeros(len(law.reference))
            status = ours.step(*at)[0]
            assert status == truth.step(*at)[0], (ratio, angle)
            seen.add((ours._self.regular_margin > 0, status))
    assert seen == {(True, "ok"), (False, "ok"), (False, "singular")}


def test_a_margin_is_below_the_difference_at_all_angles():
    """Exactly, at random angles, of every entry point of Type I that inverts Phi."""
    bodies = [body for body in compiled("type_i").entries.values() if body.singular]
    for body, seed in itertools.product(bodies, range(5)):
        margin, one, other = evaluate([body.margin, *body.singular], random_leaves(seed))
        assert margin < one - abs(other)
    assert bodies


def singular_place(Phi, leaf):
    """Where det Phi changes sign as the heading or L is moved, and leaves with that moved."""

    def moved(name: str):
        return lambda value: with_foot(lambda node: value if node.name == name else leaf(node))

    def determinant(leaves) -> mpmath.mpf:
        return mpmath.det(mpmath.matrix([evaluate(row, leaves) for row in Phi]))

    for name, size in (("phi", mpmath.pi), ("heading", mpmath.pi), ("L", 5)):
        at = moved(name)
        places = [size * (mpmath.mpf(k) / 8 - mpmath.mpf("0.97")) for k in range(17)]
        signs = [determinant(at(place)) > 0 for place in places]
        varies = any(isinstance(node, Leaf) and node.name == name for row in Phi for node in reachable(row))
        if not varies or len(set(signs)) == 1:
            continue
        change = next(k for k in range(16) if signs[k] != signs[k + 1])
        low, high = places[change], places[change + 1]
        for _ in range(100):
            middle = (low + high) / 2
            low, high = (middle, high) if (determinant(at(middle)) > 0) == signs[change] else (low, middle)
        return low, at
    raise AssertionError("regular everywhere")


@each_law
def test_names_stand_for_their_values(name):
    """A named row or torque in C is that row or torque."""
    law, leaf = laws()[name], random_leaves(3)
    plain = compile_law(law, optimize=False)
    truth: dict[str, list] = {}
    for node, label in plain.labels.items():
        truth.setdefault(label, []).extend(evaluate([node], leaf))
    program = compiled(name)
    written = reachable(root for body in program.entries.values() for root in body.roots)
    for node, label in ((node, program.labels[node]) for node in written if node in program.labels):
        # a demand is a leaf in one and a sum in the other
        if label in truth and not label.startswith(("u_", "v_")):
            (value,) = evaluate([node], leaf)
            assert any(abs(value - t) <= EXACT * max(abs(t), 1) for t in truth[label]), label


@each_labmate_law
def test_fewer_operations_than_the_plain_law(name):
    plain = compiled(name, optimize=False)
    for entry, body in compiled(name).entries.items():
        both = []
        for roots in (body.roots, plain.entries[entry].roots):
            both.append(sum(count(executed(roots)).values()))
        assert both[0] <= both[1], entry.name
        if entry.name == "step":
            assert both[0] < 0.65 * both[1]


# -- second derivatives --------------------------------------------------------------------------------------

CURVES = {
    "constant": lambda x, y, p: p + 0 * x,
    "linear": lambda x, y, p: p * x - y - 2,
    "square": lambda x, y, p: x**2 - y * y / p,
    "circle": lambda x, y, p: ca.sqrt((x - p) ** 2 + (y - 1) ** 2) - p,
    "ellipse": lambda x, y, p: ((x / p) ** 2 + y**2 - 1) / ca.sqrt(4 * x**2 / p**4 + 4 * y**2),
    "wave": lambda x, y, p: y - p * ca.sin(x * y) + ca.cos(-x),
    "inverse": lambda x, y, p: 1 / (x**2 + p) - 1 / (1 + ca.sin(y) ** 2),
    "quotient": lambda x, y, p: (x + ca.sin(y)) / (p + ca.cos(x * y) ** 2) - ca.sqrt(x**2 + 1) * 2 * y,
    "cube": lambda x, y, p: (x**2 * x - 2 * (x + y)) * -y,
}


@pytest.mark.parametrize("curve", CURVES)
def test_derivatives_along_a_motion(curve):
    """Second derivative of the curve, and first of its gradient, against CasADi's."""
    z, zdot, p = ca.SX.sym("z", 2), ca.SX.sym("zdot", 2), ca.SX.sym("p")
    outer = ca.SX(CURVES[curve](z[0], z[1], p))
    rate = ca.jtimes(outer, z, zdot)
    taylor, gradient = Taylor(outer, z, zdot, rate, lambda expression: expression), ca.gradient(outer, z)
    ours = ca.vertcat(taylor.second(outer), *[taylor.first(entry) for entry in ca.vertsplit(gradient)])
    casadis = ca.vertcat(ca.jtimes(rate, z, zdot), ca.jtimes(gradient, z, zdot))
    function = ca.Function("both", [z, zdot, p], [ours, casadis])
    source = np.random.default_rng(5)
    for _ in range(200):
        x = source.uniform(0.3, 2, 2) * source.choice((-1, 1), 2)
        a, b = (np.asarray(value) for value in function(x, source.uniform(-2, 2, 2), source.uniform(0.5, 2)))
        assert np.all(np.abs(a - b) <= 1e-11 * np.maximum(1, np.abs(b)))


def test_derivatives_use_the_known_rate():
    z, zdot, rate = ca.SX.sym("z", 2), ca.SX.sym("zdot", 2), ca.SX.sym("rate")
    outer = ca.sqrt(z[0] ** 2 + z[1] ** 2) - 3
    taylor = Taylor(outer, z, zdot, rate, lambda expression: expression)
    assert ca.depends_on(taylor.second(outer), rate) and ca.depends_on(
        taylor.first(z[0] / outer.dep(0)), rate
    )


def test_a_law_is_derived_again_after_many_others():
    """A process that derives the laws of many robots forgets the oldest parts;
    what remains must fit what is made again."""
    law = law_of(find_robot("knife_edge"), "type_i")
    first = compile_law(law)
    inner_velocities.cache_clear()
    again = compile_law(law)
    assert [entry.name for entry in again.entries] == [entry.name for entry in first.entries]
    assert law_text(again, SCALARS["double"]).source() == law_text(first, SCALARS["double"]).source()


# -- structure -----------------------------------------------------------------------------------------------


def law_function(text: str, name: str) -> str:
    """The body of a static function of the C."""
    return re.search(
        rf"^(?:static|NOSLIP_HOT) int \w+_{name}(?:_f)?_law\(.*?\n\{{\n(.*?)^\}}", text, re.S | re.M
    )[1]


@each_labmate_law
def test_masses_and_bias_do_not_know_the_heading(name):
    """The same accelerations at the same rates need the same torques in every place and direction."""
    law = laws()[name]
    inner, _ = inner_velocities(law.system)
    for masses_and_bias in ((inner.Mbar, inner.bias), (law.system.Mbar, law.system.bias)):
        assert not any(ca.depends_on(matrix, law.system.mechanism.q) for matrix in masses_and_bias)
    entry = next(entry for entry in compiled(name).entries if entry.name == "feedback")
    roots = [node for row in compiled(name).entries[entry].quantities["tau_of_v"] for node in row]
    functions = {"sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "abs": abs}
    degrees = np.array(law.linearization.relative_degree)
    (plant, *_), u, nu = random_plants(law, 20, seed=2), np.array([3.0, -1.7]), np.array([4.0, 2.5])
    controller, torques = CasadiController(law, plant.params, plant.config, plant.gains), []
    for point in plant.points:
        state = np.concatenate([point.state[:-2], nu])
        found = controller.evaluate(state, point.reference).values
        v = found["Phi"] @ u + np.where(degrees == 2, found["Phidot"] @ nu, 0)
        groups = {
            "params": plant.params,
            "config": plant.config,
            "gains": plant.gains,
            "state": state,
            "virtual_input": v,
        }
        given = {
            (g, q.name): value
            for g, values in groups.items()
            for q, value in zip(law.groups[g], values, strict=True)
        }
        torques.append(evaluate(roots, lambda n, given=given: given[n.group, n.name], float, functions))
    assert np.ptp(torques, axis=0).max() <= 1e-10 * np.abs(torques).max()


@each_scalar
@each_labmate_law
def test_one_sincos(name, scalar):
    text = law_text(compiled(name), SCALARS[scalar])
    source = text.source()
    for entry in text.entries:
        assert law_function(source, entry.name).count("noslip_sincos") <= 1


# -- printing ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scalar", [DOUBLE, FLOAT])
def test_literals_are_the_shortest_that_read_back(scalar):
    kind, bits = (np.float64, np.uint64) if scalar is DOUBLE else (np.float32, np.uint32)
    source = np.random.default_rng(11)
    values = np.concatenate(
        [source.integers(0, np.iinfo(bits).max, 3000, bits, True).view(kind), np.arange(-20, 20).astype(kind)]
    )
    values = np.concatenate(
        [values, source.uniform(-10, 10, 1000).astype(kind), [np.finfo(kind).tiny, np.finfo(kind).max]]
    )
    assert scalar.literal(np.nextafter(float(np.finfo(kind).tiny), 1.0)).startswith(
        str(np.finfo(kind).tiny)[:6]
    )
    for value in values[np.isfinite(values)]:
        text = scalar.literal(float(value))
        assert re.fullmatch(r"-?\d+(\.\d+)?(e[-+]?\d+)?f?", text) and ("." in text or "e" in text)
        assert text.endswith("f") == (scalar is FLOAT)
        assert kind(text.rstrip("f")) == value
        digits = len(re.sub(r"e.*|\D", "", text).strip("0"))
        assert digits <= 1 or kind(f"{value:.{digits - 2}e}") != value, f"{text} could be shorter"


@pytest.mark.parametrize(
    ("scalar", "value"),
    [
        (FLOAT, 1e39),
        (FLOAT, -3.5e38),
        (FLOAT, 1e-50),
        (FLOAT, np.inf),
        (FLOAT, np.nan),
        (DOUBLE, np.inf),
        (DOUBLE, np.nan),
    ],
)
def test_a_constant_that_does_not_fit_is_refused(scalar, value):
    with pytest.raises(ModelError, match="does not fit|not finite"):
        scalar.literal(value)


RANDOM_C = 60  # graphs


def graph_in_c(k: int, scalar) -> str:
    """A C function that computes the roots of random graph k from an array of leaves."""
    _, roots = random_graph(k)
    writer = Statements(
        scalar,
        lambda node: f"x->{node.name}" if isinstance(node, Leaf) else None,
        {},
        lambda c: f"if ({c}) {{ return 1; }}",
    )
    writer.plan(roots)
    for i, root in enumerate(roots):
        writer.assign(f"out[{i}]", root)
    return (
        f"int graph{k}(const leaves *x, {scalar.real} *out)\n{{\n"
        + "\n".join(writer.lines)
        + "\nreturn 0;\n}\n"
    )


@each_scalar
def test_random_c_computes_what_the_graph_says(scalar):
    """Parentheses, order, names: bit by bit what the operations give when each is rounded once."""
    kind, real = NUMPY[scalar], SCALARS[scalar].real
    names = [f"{group[0]}{k}" for group in GROUPS for k in range(3)]
    struct = f"typedef struct leaves {{ {real} {', '.join(dict.fromkeys(names))}; }} leaves;\n"
    trig = f"void trig({real} x, {real} *sine, {real} *cosine)"
    sincos = f"{trig}\n{{\n{SCALARS[scalar].name('noslip_sincos')}(x, sine, cosine);\n}}\n"
    text = (
        '#include "noslip_controller.h"\n'
        + struct
        + sincos
        + "".join(graph_in_c(k, SCALARS[scalar]) for k in range(RANDOM_C))
    )
    ffi = cffi.FFI()
    ffi.cdef(
        struct + trig + ";" + "".join(f"int graph{k}(const leaves *x, {real} *out);" for k in range(RANDOM_C))
    )
    lib = ffi.dlopen(str(shared_library({"graphs.c": text})))
    sine, cosine = ffi.new(f"{real} *"), ffi.new(f"{real} *")

    def c_sincos(angle):
        lib.trig(float(angle), sine, cosine)
        return sine[0], cosine[0]

    source, leaves, out, compared = np.random.default_rng(3), ffi.new("leaves *"), ffi.new(f"{real}[6]"), 0
    for k in range(RANDOM_C):
        _, roots = random_graph(k)
        for _ in range(20):
            given = {name: kind(source.uniform(-2, 2)) for name in names}
            for name, value in given.items():
                setattr(leaves, name, float(value))
            if getattr(lib, f"graph{k}")(leaves, out) != 0:
                continue
            with np.errstate(all="ignore"):
                expected = evaluate(roots, lambda n, given=given: given[n.name], kind, in_c(kind, c_sincos))
            answered = np.array(list(out), kind)
            assert np.array_equal(answered, np.array(expected, kind), equal_nan=True), k
            compared += 1
    assert compared > 0.8 * RANDOM_C * 20


@each_scalar
@each_law
def test_laws_in_c_compute_what_the_graph_says(name, scalar):
    """Every bit of h, ydot, Phi, Phidot, u, tau at random states, init's constants included."""
    law, kind = laws()[name], NUMPY[scalar]
    program, built = compiled(name), library(law, scalar)
    trig = cffi.FFI()
    real = SCALARS[scalar].real
    trig.cdef(f"void trig({real} x, {real} *sine, {real} *cosine);")
    source = (
        f'#include "noslip_trig.h"\nvoid trig({real} x, {real} *s, {real} *c);\nvoid trig({real} x, '
        f"{real} *s, {real} *c)\n"
    )
    lib = trig.dlopen(
        str(
            shared_library(
                {"trig.c": source + f"{{\n{SCALARS[scalar].name('noslip_sincos')}(x, s, c);\n}}\n"}
            )
        )
    )
    sine, cosine = trig.new(f"{real} *"), trig.new(f"{real} *")

    def c_sincos(angle):
        lib.trig(float(angle), sine, cosine)
        return sine[0], cosine[0]

    entry = next(entry for entry in program.entries if entry.name == "evaluate")
    quantities = program.entries[entry].quantities
    places, roots = zip(
        *[(name, node) for name, matrix in quantities.items() for row in matrix for node in row], strict=True
    )
    for plant in random_plants(law, 40, seed=21):
        controller = CompiledController(law, plant.params, plant.config, plant.gains, scalar)
        for point in plant.points:
            answer = controller.evaluate(point.state, point.reference)
            groups = dict(
                zip(
                    GROUPS,
                    (plant.params, plant.config, plant.gains, point.state, point.reference),
                    strict=True,
                )
            )
            given = {
                (g, q.name): kind(v) for g in GROUPS for q, v in zip(law.groups[g], groups[g], strict=True)
            }
            assert answer.status == "ok"
            expected = evaluate(
                roots, lambda n, given=given: given[n.group, n.name], kind, in_c(kind, c_sincos)
            )
            answered = [float(value) for quantity in quantities for value in answer.values[quantity].ravel()]
            wrong = [name for name, a, b in zip(places, answered, expected, strict=True) if a != float(b)]
            assert wrong == []
            assert controller.step(point.state, point.reference)[0] == "ok"
    assert built.text.program.law is law


def test_names_of_the_path_may_be_those_of_the_robot():
    """The ellipse's b beside half the wheels' distance b: both count, each for itself."""
    law = laws()["type_iv_ellipse"]
    assert "b" in [q.name for q in law.parameters] and "b" in [q.name for q in law.config]
    for changed in (None, "params", "config"):
        values = {g: [q.default or 0.3 for q in law.groups[g]] for g in ("params", "config", "gains")}
        if changed:
            values[changed][[q.name for q in law.groups[changed]].index("b")] *= 1.7
        numbers = [values[g] for g in ("params", "config", "gains")]
        state, reference = np.array([4.1, 0.5, 1.2, 0, 0, 7.0, 9.0]), np.array([0.1, 0.2, 0.3, 1.0, 0.4])
        ours, truth = (
            made(law, *numbers).evaluate(state, reference) for made in (CompiledController, CasadiController)
        )
        for quantity in quantities_of(ours):
            assert (
                np.abs(ours.values[quantity] - truth.values[quantity]).max()
                <= 1e-12 * np.abs(truth.values[quantity]).max()
            )


def quantities_of(evaluation) -> list[str]:
    assert evaluation.status == "ok"
    return [name for name, value in evaluation.values.items() if value.size]


@pytest.mark.parametrize(
    "names",
    [
        "k1 ready self tau x_l_rate",
        "k2 held state h Phi_11",
        "t1 limit reference all yaw_rate",
        "options config sin_heading part forward_speed",
        "params gains status root",
    ],
)
def test_any_name_of_a_parameter_gives_c(names):
    """What the generator calls its own does not meet what the user calls hers. Each is a number that the step
    itself uses."""
    mass, *pulls = names.split()
    robot = unicycle(f"u_{mass}", mass)
    x, y, _ = ca.vertsplit(robot.q)
    for pull, energy in zip(pulls, (x, y, x**2 / 2, y**2 / 2), strict=False):
        robot.potential_energy(robot.parameter(pull, 1.3, "N") * energy)
    law = control_law(system := reduce(robot), OUTPUTS["type_i"](system))
    leaves = {node.name for node in compile_law(law).constants if isinstance(node, Leaf)}
    assert leaves >= set(names.split())
    numbers = [[q.default or 0.3 for q in law.groups[g]] for g in ("params", "config", "gains")]
    state, reference = np.array([1.0, 0.5, 1.2, 0.7, 0.9]), np.array([0.1, 0.2, 0.3, 1.0, 0.4, 0.2])
    ours, truth = (
        made(law, *numbers).evaluate(state, reference) for made in (CompiledController, CasadiController)
    )
    for quantity in quantities_of(ours):
        assert (
            np.abs(ours.values[quantity] - truth.values[quantity]).max()
            <= 1e-13 * np.abs(truth.values[quantity]).max()
        )


@pytest.mark.parametrize(
    ("row", "other"),
    [
        ("k1", "t1"),
        ("self", "state"),
        ("reference", "tau"),
        ("h", "all"),
        ("status", "sin_heading"),
        ("Phi", "t2"),
    ],
)
def test_any_name_of_an_output_gives_c(row, other):
    system = reduce(unicycle(f"o_{row}"))
    x, y, heading = ca.vertsplit(system.mechanism.q)
    point = (x + 0.3 * ca.cos(heading), y + 0.3 * ca.sin(heading))
    rows = [
        OutputRow(name, "m", "of a point ahead", place)
        for name, place in zip((row, other), point, strict=True)
    ]
    law = control_law(system, OutputMap("own", "own", tuple(rows)))
    numbers = [[q.default for q in law.groups[g]] for g in ("params", "config", "gains")]
    state, reference = np.array([1.0, 0.5, 0.4, 0.7, 0.9]), np.arange(6) / 7
    ours, truth = (
        made(law, *numbers).evaluate(state, reference) for made in (CompiledController, CasadiController)
    )
    for quantity in quantities_of(ours):
        assert (
            np.abs(ours.values[quantity] - truth.values[quantity]).max()
            <= 1e-13 * np.abs(truth.values[quantity]).max()
        )


# -- what cannot be written in C -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "function", [ca.floor, ca.erf, ca.asinh, ca.log1p, lambda x: ca.fmod(x, 2), lambda x: ca.copysign(1, x)]
)
@pytest.mark.parametrize("optimize", [True, False])
def test_functions_without_c(function, optimize):
    """Of the graph and of a path, which refuses jumps first;
    a robot's own file is refused earlier: test_functions.py."""
    graph, x = Graph(), ca.SX.sym("x")
    with pytest.raises(ModelError, match="robot law: .* not supported in generated C; use") as error:
        from_casadi(graph, ca.SX(function(x)), [x], [graph.leaf("state", "x")], "robot law")
    assert "\n" not in str(error.value)
    system = system_of(find_robot("labmate"))
    with pytest.raises(ModelError, match="distance: .* not supported|path 'odd': .* jumps"):
        compile_law(
            control_law(system, type_iv(system, implicit("odd", "odd", (), lambda x, y: y - function(x)))),
            optimize,
        )


@pytest.mark.parametrize("exponent", [-3, -1.7, -0.5, 0, 0.3, 0.5, 1, 1.5, 2, 3, 7, 2.5, 32])
def test_powers(exponent):
    """Whole and half ones are products and roots."""
    graph, symbol = Graph(), ca.SX.sym("x")
    leaf = graph.leaf("state", "x")
    (((node,),)) = from_casadi(graph, ca.SX(symbol**exponent), [symbol], [leaf], "")
    value = mpmath.mpf("1.37")
    (ours,) = evaluate([node], lambda _: value)
    assert abs(ours - value ** mpmath.mpf(exponent)) <= EXACT * ours
    assert ("pow" in {getattr(each, "operation", "") for each in reachable([node])}) == (
        2 * exponent % 1 != 0
    )


def test_tangent():
    graph, symbol = Graph(), ca.SX.sym("x")
    (((node,),)) = from_casadi(graph, ca.tan(symbol), [symbol], [graph.leaf("state", "x")], "")
    (ours,) = evaluate([node], lambda _: mpmath.mpf("0.7"))
    assert abs(ours - mpmath.tan(mpmath.mpf("0.7"))) <= EXACT


def in_folder(folder: Path) -> set[str]:
    """The files in a folder and below it, by their paths in it."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


# -- files ---------------------------------------------------------------------------------------------------


def test_shipped_files_are_current(capsys):
    assert main(["generate", "labmate", "-o", str(SHIPPED), "--check"]) == 0, "run noslip generate labmate"


@pytest.mark.parametrize("names", [("type_i", "type_iv_segment"), tuple(OUTPUTS)], ids=["some", "all"])
def test_the_same_bytes_everywhere(names, tmp_path):
    """Under another hash seed, from another folder, in another process."""
    run = "import sys; from noslip.cli.main import main; sys.exit(main())"
    command = [sys.executable, "-c", run, "generate", "labmate", "-o", "here"]
    command += [word for name in (*names, "dynamics") for word in ("--output", name)]
    environment = os.environ | {"PYTHONHASHSEED": "4242"}  # this process has a random one
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL)
    system = system_of(find_robot("labmate"))
    ours = robot_files(system, [law_of(system, name) for name in names], lanes=True)
    assert process.wait() == 0
    fresh = find_robot.__wrapped__("labmate")
    assert ours == robot_files(system_of(fresh), [law_of(fresh, name) for name in names], lanes=True)
    folder = tmp_path / "here" / "labmate"
    written = {name: (folder / name).read_bytes() for name in in_folder(folder)}
    assert written == {name: text.encode() for name, text in ours.items()}


@pytest.fixture
def small(tmp_path, capsys):
    """A generated folder of one law, and a check of it: answers exit code and what it says."""
    argv = ["generate", "labmate", "-o", str(tmp_path), "--output", "type_ii", "--scalar", "double"]
    assert main(argv) == 0

    def check() -> tuple[int, str]:
        capsys.readouterr()
        before = {path: path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()}
        code = main([*argv, "--check"])
        assert {path: path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()} == before
        return code, capsys.readouterr().err

    return tmp_path / "labmate", check


def test_check_of_what_is_current(small):
    assert small[1]() == (0, "")


def test_check_sees_an_extra_file(small):
    folder, check = small
    (folder / "labmate_type_ix.c").write_text("int x;\n")
    code, err = check()
    assert code == 1 and "labmate_type_ix.c" in err and "remove" in err


def test_check_sees_an_extra_folder(small):
    folder, check = small
    (folder / "old").mkdir()
    code, err = check()
    assert code == 1 and "old" in err


@pytest.mark.parametrize("name", ["labmate.h", "labmate_type_ii.c", "manifest.json"])
def test_check_sees_a_missing_file(small, name):
    folder, check = small
    (folder / name).unlink()
    code, err = check()
    assert code == 1 and f"{name}: missing" in err


def test_check_of_a_missing_folder(small):
    folder, check = small
    shutil.rmtree(folder)
    code, err = check()
    assert code == 1 and err.count(": missing;") == 7


@pytest.mark.parametrize(
    ("old", "new", "shown"),
    [(b" + ", b" - ", True), (b"\n", b"\r\n", False), (b"\n", b"\n\xff", True), (b"}\n", b"}", False)],
)
def test_check_sees_an_edited_file(small, old, new, shown):
    folder, check = small
    path = folder / "labmate_type_ii.c"
    text = path.read_bytes()
    place = text.rindex(old)
    path.write_bytes(text[:place] + new + text[place + len(old) :])
    code, err = check()
    assert code == 1 and f"--- {path}" in err and "@@" in err
    if shown:
        assert any(line.startswith("-") and not line.startswith("---") for line in err.splitlines())


def test_generating_again_removes_what_it_wrote_before_and_nothing_else(small):
    folder, check = small
    (folder / "notes.txt").write_text("mine\n")
    assert (
        main(["generate", "labmate", "-o", str(folder.parent), "--output", "type_iii", "--scalar", "float"])
        == 0
    )
    made = ("labmate", "labmate_type_iii", "lanes/labmate_type_iii_steps")
    assert in_folder(folder) == {"notes.txt", "manifest.json"} | {f"{n}_f.{e}" for n in made for e in "hc"}


@pytest.mark.parametrize(
    "argv",
    [["labmates"], ["labmate", "--output", "type_v"], ["labmate", "--scalar", "half"], ["nowhere.py:robot"]],
)
def test_generate_refuses(argv, bad_input, tmp_path):
    bad_input(["generate", *argv, "-o", str(tmp_path / "c")])


def test_generate_where_nothing_can_be_written(bad_input, tmp_path):
    (tmp_path / "file").write_text("")
    bad_input(["generate", "labmate", "--output", "type_ii", "-o", str(tmp_path / "file")])


SUM_OR_DIFFERENCE = {"+": "add", "-": "sub", "*": "mul", "/": "div"}


def recount(body: str) -> dict[str, int]:
    """Operations in the text of a C function, comments and guards of divisions left out."""
    found = dict.fromkeys(("mul", "add", "sub", "neg", "div", "sqrt", "abs", "sincos"), 0)
    body = re.sub(r"/\*.*?\*/", "", body, flags=re.S)
    body = re.sub(r"if \(!\((?:noslip_abs(?:_f)?\()?[\w>-]+\)? > 0\)\) \{", "", body)
    body = re.sub(r"\(void\)\w+;|(float|double) \w+, \w+;", "", body)
    before = "="
    for token in re.findall(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?f?|\w+|->|[-+*/()=;>!{}&,\[\]]", body):
        if token in SUM_OR_DIFFERENCE:
            unary = before in ("=", "(", ",", "+", "-", "*", "/", ">") or before == "return"
            found["neg" if unary else SUM_OR_DIFFERENCE[token]] += 1
        for function in ("sqrt", "abs", "sincos"):
            found[function] += bool(re.fullmatch(f"noslip_{function}(_f)?", token))
        before = token
    found["neg"] -= len(re.findall(r"return -|[(=,*/+] -\d", body))
    return found


@each_scalar
@each_labmate_law
def test_operation_counts_are_those_of_the_text(name, scalar):
    """What the shipped manifest and header (source for what is not public) say,
    counted again in the shipped C."""
    folder, own = SHIPPED / "labmate", f"labmate_{name}{SCALARS[scalar].suffix}"
    manifest = json.loads((folder / "manifest.json").read_text())["laws"][name]["operations"]
    source, header = ((folder / f"{own}.{kind}").read_text() for kind in "ch")
    assert manifest.keys() == {entry.name for entry in compiled(name).entries}
    inside = {entry.name for entry in compiled(name).entries if not entry.public}
    expected = {"slope"} if 1 in compiled(name).law.linearization.relative_degree else set()
    assert inside == expected | {"wheels"} | ({"follow_slope"} if name == "type_iv_segment" else set())
    for entry, listed in manifest.items():
        counted = recount(law_function(source, entry))
        assert counted == listed, entry
        said = ", ".join(f"{number} {operation}" for operation, number in counted.items() if number)
        function = f"labmate_{name}_{entry}{SCALARS[scalar].suffix}{'_law' if entry in inside else ''}("
        text = " ".join((source if entry in inside else header).replace(" * ", " ").split())
        before = text[: text.index(f"int {function}")]
        assert before[before.rindex("Operations:") :].startswith(f"Operations: {said or 'none'}."), entry


def test_nothing_of_this_machine_in_the_text():
    for text, path in (
        (path.read_text(), path)
        for path in map((SHIPPED / "labmate").joinpath, in_folder(SHIPPED / "labmate"))
    ):
        assert (
            text.isascii()
            and "\t" not in text
            and "\r" not in text
            and text.endswith("\n")
            and not text.endswith("\n\n")
        )
        assert not re.search(r"\b20\d\d\b|\d:\d\d|[A-Z][a-z]{2} \d{1,2},", text)
        assert not any(
            part in text for part in (str(ROOT), str(Path.home()) + "/", "/tmp", "/usr", os.uname().nodename)
        )
        assert all(len(line) <= 120 for line in text.splitlines())
        assert all(line == line.rstrip() for line in text.splitlines())
        if path.suffix != ".json":
            assert f"Generated by noslip {noslip.__version__}" in text and re.search(
                r"Model SHA-256 [0-9a-f]{64}", text
            )


def test_the_hash_follows_the_model():
    """Whatever changes the C changes the hash in its banner."""
    system = reduce(unicycle())
    base = robot_files(system, [law_of(system, "type_i")])
    other = reduce(unicycle(mass="m_2"))
    changed = robot_files(other, [law_of(other, "type_i")])
    assert base.keys() == changed.keys()
    for name in base:
        first, second = (re.findall(r"[0-9a-f]{64}", files[name])[0] for files in (base, changed))
        assert first != second


def test_comments_of_an_extended_law():
    """Its virtual input is the highest derivative of the outputs, and `rate` has those below."""
    law = law_of(find_robot("labmate"), "type_i_extended")
    files = robot_files(law.system, [law], ("double",))
    for name, about in (
        ("rate", "Derivatives of the outputs below the highest"),
        ("step", "First the states of the extension"),
    ):
        text = " ".join(files["labmate_type_i_extended.h"].replace(" * ", " ").split())
        before = text[: text.index(f"int labmate_type_i_extended_{name}(")]
        assert about in before[before.rindex("/*") :], name


def test_comments_of_constants_are_what_init_makes():
    """Each formula beside a constant, read as mathematics, is the value that init puts there;
    its unit is by hand here."""
    law = law_of(find_robot("labmate"), "type_i")
    program, known = law_program(law), meanings(law_program(law))
    random = np.random.default_rng(7)
    groups = [law.groups[group] for group in ("params", "config", "gains")]
    values = {q.name: float(random.uniform(0.3, 2)) for group in groups for q in group}
    made = library(law, "double")
    kinds = (made.robot_name("params"), made.name("config"), made.name("gains"))
    structs = [
        made.struct(kind, [values[q.name] for q in group]) for kind, group in zip(kinds, groups, strict=True)
    ]
    self = made.instance()
    assert made.function("init")(self, *structs, made.ffi.NULL) == 0
    read = 0
    for node, field in program.constants.items():
        formula = known.formula(node)
        if formula.startswith("of "):
            assert set(formula[3:].partition(";")[0].split(", ")) <= values.keys()
            continue
        python = re.sub(r"(?<=[\w)]) (?=[\w(])", "*", formula).replace("^", "**")
        assert abs(eval(python, {}, values) - getattr(self, field)) <= 1e-12 * abs(getattr(self, field)), (
            formula
        )
        read += 1
    assert read >= 15
    units = {
        known.formula(node): known.constant(node).partition(":")[0]
        for node in program.constants
        if node.arguments
    }
    assert (
        units["b^2"] == "m^2"
        and units["1/(L + d)"] == "1/m"
        and units["(2 I_w + m_c r^2 + 2 m_w r^2)/(2 r)"] == "kg m"
    )


def test_temporaries_are_said_in_the_derivation_s_names():
    """A multiple of a step is named as such; what has no short formula says what it goes into;
    none is without a comment."""
    text = law_text(law_program(law_of(find_robot("labmate"), "type_i")), DOUBLE).source()
    assert "const double t2 = state->thetadot_r - state->thetadot_l; /* 2 b yaw_rate/r */" in text
    assert "part of tau[0], tau[1] */" in text and "see init" not in text
    lines = text.splitlines()
    bare = [
        k for k, line in enumerate(lines) if re.match(r" +const double t\d+ = ", line) and line.endswith(";")
    ]
    assert all(lines[k - 1].endswith("*/") for k in bare)


def test_a_fingerprint_sees_the_last_bit_of_a_constant():
    """CasADi prints constants with six digits."""

    def of(mass: float) -> str:  # kg, added to the first coordinate
        robot = unicycle()
        robot.kinetic_energy(mass * robot.rate(robot.coordinates[0].symbol) ** 2 / 2)
        return fingerprint(reduce(robot))

    assert of(0.2) == of(0.2) != of(math.nextafter(0.2, 1.0))


@pytest.mark.parametrize("trailers", [8, pytest.param(16, marks=pytest.mark.nightly)])
def test_work_of_a_derivation_grows_with_the_number_of_bodies(trailers, monkeypatch):
    """Expressions that are brought into canonical form for the reduction, a law and the forces at the ground,
    each of at most LARGEST operations, and the operations of the law and of these forces. With the velocities
    of all constraints as columns, the forces took 2281 with 16."""
    examined, original = [], entries.examined
    monkeypatch.setattr(exact, "_known", {})
    monkeypatch.setattr(
        entries, "examined", lambda entry, symbols: (examined.append(entry), original(entry, symbols))[1]
    )
    program = compile_law(law_of(system_of(find_robot.__wrapped__(f"tractor_trailer:{trailers}")), "type_i"))
    assert len(examined) <= 170 + 24 * trailers
    of = {entry.name: sum(count(executed(body.roots)).values()) for entry, body in program.entries.items()}
    assert of["step"] <= 55 + 26 * trailers and of["ground"] <= 30 + 54 * trailers
