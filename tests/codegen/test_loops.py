"""Repeated steps as loops: the same operations on the same values, in less code."""

import ctypes
import importlib
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from noslip.codegen.graph import Applied, Graph, Leaf, Node, Operation, executed, reachable
from noslip.codegen.loops import Repetition, find_loops
from noslip.codegen.printing import law_c
from noslip.codegen.printing.rolled import Rolled, WrongLoop, numbered, write_constants
from noslip.codegen.printing.scalar import DOUBLE
from noslip.codegen.printing.statements import Statements
from noslip.codegen.runtime import RUNTIME

LINKS = 9


def chain(links: int = LINKS) -> tuple[Graph, list[Node]]:
    """Sums along a chain of links: angles between them, velocities from the first to the last, forces from the last to the
    first, and what both give; the first and the last link are different, as those of robots are."""
    graph = Graph()
    g = graph.apply
    heading = [graph.leaf("state", f"q_{k}") for k in range(links)]
    mass = [graph.leaf("params", f"m_{k}") for k in range(links)]
    speed, total = graph.leaf("state", "v"), graph.constant(2)
    speeds, turns = [speed], [speed]
    for k in range(1, links):
        fold = g(Operation.SUB, heading[k - 1], heading[k])
        turns.append(g(Operation.MUL, speeds[-1], g(Operation.SIN, fold)))
        speeds.append(g(Operation.MUL, speeds[-1], g(Operation.COS, fold)))
        total = g(Operation.ADD, total, g(Operation.MUL, g(Operation.MUL, mass[k], speeds[k]), speeds[k]))
    force = g(Operation.NEG, turns[-1])
    for k in range(links - 1, 0, -1):
        lifted = g(Operation.ADD, g(Operation.MUL, force, speeds[k]), g(Operation.MUL, mass[k - 1], turns[k]))
        force = g(Operation.SUB, lifted, g(Operation.MUL, speeds[k - 1], total))
    return graph, [total, force, speeds[links // 2]]


def written(roots: list[Node], loops: list[Repetition] | None) -> list[str]:
    """The statements that assign the roots to y, of x and p."""

    def given(node: Node) -> str | None:
        if not isinstance(node, Leaf):
            return None
        stem, _, number = node.name.partition("_")
        return {"q": f"x[{number or 0}]", "m": f"p->m_{number}", "v": f"x[{LINKS}]"}[stem]

    arguments = (DOUBLE, given, {}, None, ("x", "p", "y"))
    writer = (
        Statements(*arguments) if loops is None else Rolled(loops, lambda angle: f"if (!({angle} < 1e9)) return;", *arguments)
    )
    writer.plan(roots)
    for k, root in enumerate(roots):
        writer.assign(f"y[{k}]", root)
    return writer.lines


def test_a_chain_becomes_two_loops() -> None:
    _, roots = chain()
    loops = find_loops(roots)
    assert sorted((loop.by, len(loop.rounds)) for loop in loops)[0][0] == -1
    straight = [node for node in executed(roots) if isinstance(node, Applied) and all(node not in one.nodes for one in loops)]
    assert len(straight) < 15 < len(executed(roots)) / 4
    _, longer = chain(4 * LINKS)
    operations = [node for node in executed(longer) if isinstance(node, Applied)]
    assert len([n for n in operations if all(n not in one.nodes for one in find_loops(longer))]) == len(straight)


def test_loops_give_the_bits_of_the_statements(tmp_path) -> None:
    _, roots = chain()
    both = {"straight": written(roots, None), "rolled": written(roots, find_loops(roots))}
    assert len("\n".join(both["rolled"])) < 0.7 * len("\n".join(both["straight"]))
    assert _same_bits(tmp_path, both, len(roots))


def _same_bits(folder, texts: dict[str, list[str]], count: int) -> bool:
    """Whether two functions of x and p, given by their statements, compute the same numbers y, none of them zero."""
    members = " ".join(f"double m_{k};" for k in range(LINKS))
    sincos = "static void noslip_sincos(double a, double *s, double *c) { *s = sin(a); *c = cos(a); }"
    absolute = "static double noslip_abs(double a) { return a < 0 ? -a : a; }"
    head = f"#include <math.h>\n#include <string.h>\n{sincos}\n{absolute}\ntypedef struct {{ {members} }} P;\n"
    used = "    (void)x; (void)p; (void)noslip_sincos; (void)noslip_abs;"
    functions = [
        f"void {name}(const double *x, const P *p, double *y)\n{{\n{used}\n{chr(10).join(lines)}\n}}\n"
        for name, lines in texts.items()
    ]
    (folder / "both.c").write_text(head + "\n".join(functions))
    command = ["cc", "-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "both.c", "-lm"]
    subprocess.run([*command, "-o", "both.so"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "both.so"))
    random = np.random.default_rng(23)
    for _ in range(200):
        x, p = random.normal(size=LINKS + 1), random.normal(size=LINKS)
        y = np.zeros((2, count))
        for name, out in zip(texts, y, strict=True):
            getattr(library, name)(*(ctypes.c_void_p(a.ctypes.data) for a in (x, p, out)))
        if y[0].tobytes() != y[1].tobytes() or not np.all(y[0] != 0):
            return False
    return True


def late_chain(links: int = LINKS) -> list[Node]:
    """Two sums along a chain, of which the second one begins to be regular two links later than the first."""
    graph = Graph()
    g = graph.apply
    heading = [graph.leaf("state", f"q_{k}") for k in range(links)]
    mass = [graph.leaf("params", f"m_{k}") for k in range(links)]
    speed, total, force = graph.leaf("state", "v"), graph.constant(2), graph.constant(0)
    before = speed
    for k in range(1, links):
        turn = g(Operation.MUL, before, g(Operation.SIN, g(Operation.SUB, heading[k - 1], heading[k])))
        total = g(Operation.ADD, total, g(Operation.MUL, mass[k], turn))
        part = g(Operation.SUB, turn, speed) if k == 1 else g(Operation.MUL, turn, total)
        force = g(Operation.SUB, g(Operation.MUL, force, mass[k - 1]), part)
        before = turn
    return [total, force]


def test_loops_that_begin_at_different_links_are_joined(tmp_path) -> None:
    roots = late_chain()
    (loop,) = find_loops(roots)
    assert LINKS - 4 < len(loop.rounds) < LINKS - 1
    straight, rolled = written(roots, None), written(roots, [loop])
    assert "struct" not in "\n".join(rolled)  # nothing is kept from one loop for another
    assert _same_bits(tmp_path, {"straight": straight, "rolled": rolled}, len(roots))


def test_the_constants_of_all_links_are_computed_by_a_loop(tmp_path) -> None:
    """`d` of the first link is made otherwise, so that those of all links stay outside; it is a part of other constants. `n` does
    not change from link to link."""
    graph = Graph()
    g = graph.apply
    constants: dict[Node, str] = {}
    scale = graph.leaf("params", "scale")
    n = g(Operation.MUL, scale, graph.constant(3))
    for k in range(1, LINKS):
        m, before = graph.leaf("params", f"m_{k}"), graph.leaf("params", f"m_{k - 1}")
        square = g(Operation.ADD, g(Operation.MUL, m, m), n)
        constants[square] = f"link[{k - 1}].a"
        constants[g(Operation.DIV, g(Operation.SUB, before, square), m)] = f"link[{k - 1}].b"
        partial = g(Operation.MUL, before, square) if k > 1 else g(Operation.SUB, before, m)
        constants[partial] = f"link[{k - 1}].d"
        constants[g(Operation.SUB, partial, n)] = f"own_{k}"  # before the loop, with a name for what it contains of d
    given = {leaf: f"p->{leaf.name}" for leaf in reachable(constants) if isinstance(leaf, Leaf)} | {scale: "p->m_0"}
    texts = {}
    for rolled in (False, True):
        writer = Statements(DOUBLE, given.get, {}, lambda condition: f"if ({condition}) return;", {"x", "p", "y", "self"})
        writer.plan(constants)
        fields = constants if rolled else {node: field.replace("[", "_").replace("].", "_") for node, field in constants.items()}
        finite = write_constants(writer, fields, writer.guard)
        assert sum("link[k - 1]" in line for line in writer.lines) == rolled and len(finite) == (9 if rolled else 32)
        members = "; ".join(f"double own_{k}" for k in range(1, LINKS))
        records = f"struct {{ {members}; struct {{ double a, b, d; }} link[{LINKS - 1}]; }} law, *self = &law;"
        lines = [re.sub(r"self->link_(\d+)_", r"self->link[\1].", line) for line in writer.lines]
        all_finite = re.sub(r"link_(\d+)_", r"link[\1].", " + ".join(finite))
        texts[f"rolled_{rolled}"] = [records, *lines, f"if (!({all_finite} < 1e300)) return;", "memcpy(y, self, sizeof law);"]
    assert _same_bits(tmp_path, texts, 4 * (LINKS - 1))


@pytest.mark.parametrize("changed", ["argument", "operation", "iteration"])
def test_a_wrong_loop_is_not_written(changed: str) -> None:
    graph, roots = chain()
    loops = find_loops(roots)
    loop = loops[0]
    if changed == "argument":
        position = next(
            k for k, each in enumerate(loop.arguments) if len(each) == 2 and loop.rounds[0][k].operation is Operation.SUB
        )
        arguments = tuple(each[::-1] if k == position else each for k, each in enumerate(loop.arguments))
        wrong = replace(loop, arguments=arguments)
    elif changed == "operation":
        first = [graph.apply(Operation.ABS, *n.arguments) if n.operation is Operation.SIN else n for n in loop.rounds[0]]
        wrong = replace(loop, rounds=(tuple(first), *loop.rounds[1:]))
    else:
        wrong = replace(loop, rounds=(*loop.rounds[:2], loop.rounds[3], loop.rounds[2], *loop.rounds[4:]))
    with pytest.raises(WrongLoop):
        written(roots, [wrong, *loops[1:]])


def test_what_does_not_repeat_stays_straight() -> None:
    graph = Graph()
    leaves = [graph.leaf("state", f"q_{k}") for k in range(20)]
    node = leaves[0]
    for k, leaf in enumerate(leaves[1:]):
        node = graph.apply((Operation.ADD, Operation.MUL, Operation.SUB)[k * k * k % 7 % 3], node, leaf)
    assert sum(len(loop.nodes) for loop in find_loops([node])) < 6
    assert find_loops([graph.apply(Operation.ADD, *leaves[:2])]) == []


def test_names_with_the_index() -> None:
    assert numbered("phi_3 - phi_4 + l_40", 4) == "phi_(k-1) - phi_k + l_(k+36)"
    assert numbered("Mbar11_rest/2", 2) == "Mbar11_rest/2"


@pytest.mark.nightly
def test_laws_with_loops_have_the_bits_of_those_without(tmp_path, monkeypatch) -> None:
    """Feedback, step and ground's forces of a tractor with trailers, with and without loops, at random states and at angles out
    of range."""
    from noslip.codegen.files import law_text, shared_files
    from noslip.codegen.program import compile_law
    from noslip.model.law import control_law
    from noslip.model.outputs import output_map
    from noslip.model.reduction import reduce

    system = reduce(importlib.import_module("noslip.model.robots.tractor_trailer").tractor_trailer(12))
    law = control_law(system, output_map(system, "type_i"))
    program = compile_law(law)
    outputs = []
    for rolled in (True, False):
        if not rolled:
            monkeypatch.setattr(law_c, "loops_of", lambda program: {})
            monkeypatch.setattr(law_c, "with_records", lambda program: program)
        folder = tmp_path / str(rolled)
        folder.mkdir()
        files = shared_files(system, DOUBLE) | law_text(program, DOUBLE).files()
        for name, text in files.items():
            (folder / name).write_text(text)
        assert ("for (int k" in files["tractor_trailer_12_type_i.c"]) == rolled
        outputs.append(_run(folder))
    assert outputs[0] == outputs[1] and outputs[0].count("\n") == 500


def _run(folder) -> str:
    (folder / "main.c").write_text("""#include <stdio.h>
#include "tractor_trailer_12_type_i.h"
int main(void)
{
    tractor_trailer_12_params params;
    const tractor_trailer_12_type_i_config config = {0.7};
    const tractor_trailer_12_type_i_gains gains = {1, 2, 3, 4};
    tractor_trailer_12_type_i law;
    unsigned long long seed = 1992;
    int i, k;
    if (tractor_trailer_12_default_params(&params) < 0 ||
        tractor_trailer_12_type_i_init(&law, &params, &config, &gains, 0) < 0) {
        return 1;
    }
    for (i = 0; i < 500; i++) {
        double x[sizeof(tractor_trailer_12_state) / sizeof(double)], v[2] = {1, -2}, tau[2], made[2];
        double ground[56], by_inputs[42][2];
        const tractor_trailer_12_type_i_reference reference = {1, 2, 3, 4, 5, 6};
        int stepped, held, known;
        for (k = 0; k < (int)(sizeof x / sizeof *x); k++) {
            seed = seed * 6364136223846793005ull + 1442695040888963407ull;
            x[k] = (double)(seed >> 40) / 4e6 * (i % 50 == 7 && k % 9 == i % 9 ? 1e9 : 1) - 2;
        }
        k = tractor_trailer_12_type_i_feedback(&law, (const tractor_trailer_12_state *)x, v, tau);
        stepped = tractor_trailer_12_type_i_step(&law, (const tractor_trailer_12_state *)x, &reference, made);
        held = tractor_trailer_12_type_i_ground(&law, (const tractor_trailer_12_state *)x, v, ground);
        known = tractor_trailer_12_type_i_ground_by_inputs(&law, (const tractor_trailer_12_state *)x, by_inputs);
        printf("%d %a %a %d %a %a %d %d", k, tau[0], tau[1], stepped, made[0], made[1], held, known);
        for (k = 0; k < 56; k++) {
            printf(" %a", ground[k]);
        }
        for (k = 0; k < 84; k++) {
            printf(" %a", by_inputs[k / 2][k % 2]);
        }
        printf("\\n");
    }
    return 0;
}
""")
    sources = [*sorted(path.name for path in folder.glob("*.c")), f"{RUNTIME}/noslip_status.c"]
    subprocess.run(["cc", "-std=c99", "-O1", "-I.", f"-I{RUNTIME}", *sources, "-o", "run"], cwd=folder, check=True)
    return subprocess.run(["./run"], cwd=folder, check=True, capture_output=True, text=True).stdout
