"""What `generate` and `export` write is compared with the model first: planted mistakes are found,
and nothing is written."""

import os
import re
from dataclasses import replace

import casadi as ca
import mpmath
import numpy as np
import pytest
from noslip.analysis.exact.extended import FUNCTIONS, evaluate
from noslip.checks.verification import shares, verify
from noslip.cli import INTERNAL
from noslip.cli.main import main
from noslip.codegen import files as codegen_files
from noslip.codegen import optimize
from noslip.codegen.derivation import grip, stages
from noslip.codegen.files import dynamics_program, law_program
from noslip.codegen.printing import dynamics_c, lanes_c, law_c, robot_c
from noslip.readers import kept
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.simulation.controllers.compiled import library

LAW = "type_iv_segment"  # every entry point there is


def run(command: str, tmp_path, *more: str) -> tuple[int, list]:
    """The exit code, and what the command has left."""
    folder = tmp_path / "made"
    argv = [command, "labmate", "--output", LAW, "--output", "dynamics", *more, "-o", str(folder)]
    return main(argv), sorted(tmp_path.rglob("*"))


@pytest.fixture
def not_compared(monkeypatch, tmp_path_factory):
    """Nothing is known of what has been written and compared before."""
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path_factory.mktemp("cache")))
    library.cache_clear()
    yield
    library.cache_clear()


@pytest.fixture
def afresh(not_compared):
    """Nor of programs."""
    for cached in (law_program, dynamics_program):
        cached.cache_clear()
    yield
    for cached in (law_program, dynamics_program):
        cached.cache_clear()


def all_sums(self, terms, original=optimize.Optimizer._chain):
    """A pass of the optimizer that takes some differences for sums."""
    return original(self, [(1, node) for _, node in terms] if len(terms) == 3 else terms)


def takes_one_velocity_for_another(stages_, expression, w, original=stages.by_monomials):
    return original(stages_, ca.substitute(expression, w[0], w[1]), w)


def wrong_at_standstill(stages_, expression, w, original=stages.by_monomials):
    """A factor that cancels everywhere except where the vehicle does not turn."""
    return original(stages_, expression, w) * (w[1] + 2 * w[1] ** 3) / (w[1] * (1 + 2 * w[1] ** 2))


def other_curvature(law, outputs=None, original=stages.staged):
    derived = original(law, outputs)
    if outputs is not None:  # at the foot
        derived.quantities["tau"] = 1.001 * derived.quantities["tau"]
    return derived


def wrong_slope(self, row, original=stages._Feedback.slope):
    return original(self, row) * ca.SX([1.0, -1.0])


def other_forces(inner, original=grip.staged_ground):
    """A limiter that knows the forces at the contacts, but not how the inputs change them."""
    derived = original(inner)
    return replace(
        derived,
        quantities=derived.quantities | {"ground_by_inputs": 1.001 * derived.quantities["ground_by_inputs"]},
    )


def never_singular(stages_, Phi, W, inverse, original=stages._singular):
    derived = original(stages_, Phi, W, inverse)
    return derived | {"singular": ca.vertcat(1 + derived["singular"][0] ** 2, 0)}


SLED = """
from casadi import cos, fabs, sin
from noslip.model import Mechanism

robot = Mechanism("sled", "a body on a runner, which is held back as it turns")
x, y, heading = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("heading", "rad")
m, J = robot.parameter("m", 12.0, "kg"), robot.parameter("J", 0.8, "kg m^2")
c = robot.parameter("c", 0.2, "N s")
forward = cos(heading) * robot.rate(x) + sin(heading) * robot.rate(y)
robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + J * robot.rate(heading) ** 2 / 2)
robot.rolls("no side slip", cos(heading) * robot.rate(y) - sin(heading) * robot.rate(x))
robot.force(-c * fabs(robot.rate(heading)), on=forward)
robot.input("push", "N", on=forward)
robot.input("turn", "N m", on=robot.rate(heading))
robot.quasi_velocity("v", "m/s", forward)
robot.quasi_velocity("omega", "rad/s", robot.rate(heading))
robot.moves_in_plane(x, y, heading)
"""


DEFECTS = {
    "optimizer": (optimize.Optimizer, "_chain", all_sums, ""),
    "monomials": (stages, "by_monomials", takes_one_velocity_for_another, "tau by step"),
    "standstill": (stages, "by_monomials", wrong_at_standstill, "tau by step"),
    "foot": ("noslip.codegen.derivation.foot", "staged", other_curvature, "tau by follow"),
    "slope": (stages._Feedback, "slope", wrong_slope, "tau by step, slowed"),
    "grip": ("noslip.codegen.program", "staged_ground", other_forces, "ground_by_inputs by ground_by_inputs"),
    "singular": (stages, "_singular", never_singular, "status of step differs: the C gives status ok"),
}


@pytest.mark.parametrize(
    ("command", "defect"), [*(("generate", defect) for defect in DEFECTS), ("export", "monomials")]
)
def test_a_wrong_generator_writes_nothing(command, defect, tmp_path, monkeypatch, capsys, afresh):
    place, name, wrong, says = DEFECTS[defect]
    monkeypatch.setattr(*([f"{place}.{name}", wrong] if isinstance(place, str) else [place, name, wrong]))
    code, left = run(command, tmp_path, "--scalar", "double")
    out, err = capsys.readouterr()
    assert code == 1 and left == [] and out == ""
    assert says in err and f"labmate, {LAW}, " in err and "nothing is written" in err
    assert re.search(
        r"the C gives .*; the model gives .* \(at params .*; state x_c = .*\)", err.splitlines()[0]
    )


@pytest.mark.nightly
def test_a_wrong_digit_in_the_text_is_found(tmp_path, monkeypatch, capsys, not_compared):
    """In float only: what the text says counts, not the program it was made from."""
    original = law_c.LawC.source

    def source(self):
        text = original(self)
        return text.replace(" + ", " - ", 1) if self.scalar.real == "float" else text

    monkeypatch.setattr(law_c.LawC, "source", source)
    code, left = run("generate", tmp_path)
    err = capsys.readouterr().err
    assert code == 1 and left == [] and f"{LAW}, float" in err and f"{LAW}, double" not in err


@pytest.mark.parametrize(
    "right, wrong", [("made[1] = ", "made[1] = -"), ("fine &= noslip_angle", "fine &= 1 || noslip_angle")]
)
def test_a_wrong_batch_law_writes_nothing(right, wrong, tmp_path, monkeypatch, capsys, not_compared):
    """A lane with another input, and one that is not left where its step is."""
    original = lanes_c.LanesC.source
    monkeypatch.setattr(lanes_c.LanesC, "source", lambda self: original(self).replace(right, wrong, 1))
    code, left = run("generate", tmp_path, "--scalar", "float")
    assert code == 1 and left == []
    line = capsys.readouterr().err.splitlines()[0]
    assert (
        line.startswith(f"noslip: labmate, {LAW}, float, batch law: a lane differs: it has ")
        and "; the step gives [" in line
    )


@pytest.mark.nightly
@pytest.mark.parametrize("command", ["generate", "export"])
def test_wrong_dynamics_write_nothing(command, tmp_path, monkeypatch, capsys, not_compared):
    original = dynamics_c.DynamicsC.source
    wrong = lambda self: re.sub(r"(bias\[0\] = )", r"\g<1>0.5 * ", original(self))  # noqa: E731
    monkeypatch.setattr(dynamics_c.DynamicsC, "source", wrong)
    code, left = run(command, tmp_path)
    err = capsys.readouterr().err
    assert code == 1 and left == []
    assert (
        "labmate, dynamics, double: bias by reduced differs: the C gives" in err and "; state x_c = " in err
    )


def test_what_the_generator_drops_is_found(tmp_path, capsys):
    """A force with a corner: right C, or none."""
    robot = tmp_path / "sled.py"
    robot.write_text(SLED)
    folder = tmp_path / "made"
    code = main(["generate", f"{robot}:robot", "--output", "type_i", "--scalar", "double", "-o", str(folder)])
    assert code in (0, 1) and folder.exists() == (code == 0)
    if code == 1:
        assert "sled, type_i, double: tau by" in capsys.readouterr().err
        return
    law = law_of(find_robot(f"{robot}:robot"), "type_i")
    files = {path.name: path.read_text() for path in (folder / "sled").iterdir() if path.is_file()}
    samples = [
        sample for sample in verify._LawInC(law, "double").samples(files) if sample.label == "tau by step"
    ]
    assert all(np.abs(s.value - s.expected).max() <= 1e-11 * np.abs(s.expected).max() for s in samples)


def test_c_that_does_not_compile_is_not_written(tmp_path, monkeypatch, capsys, not_compared):
    original = robot_c.refuse_parameters
    monkeypatch.setattr(law_c, "refuse_parameters", lambda *arguments: original(*arguments) + ")")
    code, left = run("generate", tmp_path)
    assert code == 1 and left == [] and "does not compile" in capsys.readouterr().err


@pytest.mark.nightly
def test_what_was_compared_is_remembered(tmp_path, monkeypatch, capsys, not_compared):
    """By the text: nothing is run again, until a file changes."""
    assert run("generate", tmp_path)[0] == 0
    marks = len([name for name in os.listdir(os.environ["NOSLIP_CACHE"]) if name.endswith(".compared")])
    assert marks == 3 * 2  # law, batch law and dynamics, double and float
    monkeypatch.setattr(verify, "_compared", lambda *_: ["compared again"])
    monkeypatch.setattr(kept, "remembered", lambda key, make, *_, **__: make())  # of whole runs
    assert run("generate", tmp_path)[0] == 0
    original = codegen_files.text_files
    more = lambda text: {  # noqa: E731
        name: t + "/* */\n" * (LAW in name) for name, t in original(text).items()
    }
    monkeypatch.setattr(codegen_files, "text_files", more)
    assert run("generate", tmp_path)[0] == 1
    assert capsys.readouterr().err.count("compared again") == 4  # the batch law with its law


@pytest.mark.nightly
@pytest.mark.parametrize("wrong", [False, True])
def test_processes_give_what_one_gives(wrong, tmp_path, monkeypatch, capsys, afresh):
    """Two laws derived and compared by one process and by two: the same files, or the same difference."""
    if wrong:
        monkeypatch.setattr(*DEFECTS["singular"][:3])
    found = []
    for count in (1, 2):
        monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / f"cache_{count}"))
        monkeypatch.setattr(shares, "processors", lambda count=count: count)
        law_program.cache_clear()
        asked = ["knife_edge", "--output", "type_i", "--output", "type_iv_line", "--scalar", "float"]
        code = main(["generate", *asked, "-o", str(folder := tmp_path / str(count))])
        files = {path.name: path.read_bytes() for path in folder.rglob("*.*")}
        found.append((code, files, capsys.readouterr().err))
    assert found[0] == found[1] and found[0][0] == wrong and bool(found[0][1]) != wrong


def test_a_run_is_remembered(tmp_path, monkeypatch, capsys, not_compared):
    """By what the robot declares: nothing is derived again, and another number is another robot. What was not
    compared is not remembered."""
    robot, folder = tmp_path / "sled.py", tmp_path / "made"

    def code(text: str = SLED) -> int:
        robot.write_text(text)
        find_robot.cache_clear()
        return main(
            ["generate", f"{robot}:robot", "--output", "dynamics", "--scalar", "double", "-o", str(folder)]
        )

    monkeypatch.setenv("CC", str(tmp_path / "no_compiler"))
    assert code() == code() == 0
    assert capsys.readouterr().err.count("the C is not compared with the model") == 2
    monkeypatch.delenv("CC")
    assert code() == 0
    first = {path: path.read_bytes() for path in folder.rglob("*.*")}

    def derived(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("noslip.cli.generate._selected_files", derived)
    assert code() == 0 and first == {path: path.read_bytes() for path in folder.rglob("*.*")}
    for old, new in (
        ("12.0", "12.5"),
        ("-c *", "-2 * c *"),
        ('"kg m^2"', '"kg m^2", "inertia"'),
        ("no side slip", "no slip"),
    ):
        assert old in SLED and code(SLED.replace(old, new)) == INTERNAL


def test_without_a_compiler_a_warning(tmp_path, monkeypatch, capsys, not_compared):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    code, left = run("generate", tmp_path)
    err = capsys.readouterr().err
    assert code == 0 and left != []
    assert (
        err.startswith("noslip: warning: the C is not compared with the model: no C compiler")
        and err.count("\n") == 1
    )


def test_every_entry_point_is_compared():
    """At as many states as promised, in both scalars."""
    law = law_of(find_robot("labmate"), LAW)
    entries = {entry.name for entry in law_program(law).entries if entry.public}
    files = library(law, "double").files
    counted: dict[str, int] = {}
    for sample in verify._LawInC(law, "double").samples(files):
        counted[sample.label] = counted.get(sample.label, 0) + 1
    assert {label.split(" by ")[-1] for label in counted if " by " in label} >= entries
    assert all(counted[f"{q} by evaluate"] == 200 for q in ("h", "ydot", "Phi", "Phidot", "u", "tau"))
    assert counted["tau by step"] == 200 and counted["tau by follow"] > 100
    assert (
        counted["tau by step, slowed"] > 50
        and counted["tau by follow, slowed"] > 50
        and counted["status of step"] > 2
    )


def test_a_value_is_excused_only_by_what_rounding_does():
    """Where two large numbers cancel, an error of their rounding is no mistake; a larger one is."""
    part = verify._DynamicsInC(system_of(find_robot("labmate")), "float")
    motion = next(iter(verify._motions(part.system)))
    inputs = dict(zip(part.groups, map(part.held, (motion.params, motion.state, motion.tau)), strict=True))
    right = part.right(inputs)["bias"]
    near, far = right * (1 + 1e-7), right * (1 + 1e-3)
    excused = lambda value: part._excused(  # noqa: E731
        verify.Sample("bias", "ok", value, right, "bias", inputs), value
    )
    assert excused(near) and not excused(far)


def test_extended_precision_has_every_digit():
    x = ca.SX.sym("x")
    (value,) = evaluate(ca.sin(x) ** 2 + ca.cos(x) ** 2 - 1 + ca.sqrt(x) / 3, [x], [2.0])
    with mpmath.workdps(45):
        assert abs(value - mpmath.sqrt(2) / 3) < mpmath.mpf(10) ** -38


@pytest.mark.parametrize("code", FUNCTIONS)
def test_extended_precision_is_casadis(code):
    """Every operation, at a few points where it is defined."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    two = FUNCTIONS[code].__code__.co_argcount == 2 if hasattr(FUNCTIONS[code], "__code__") else False
    two = two or code in (ca.OP_POW, ca.OP_CONSTPOW, ca.OP_ATAN2, ca.OP_HYPOT, ca.OP_FMIN, ca.OP_FMAX)
    if code == ca.OP_ASSIGN:
        pytest.skip("no operation of its own")
    two = two and code not in (ca.OP_LOG,)
    expression = ca.SX.binary(code, x, y) if two else ca.SX.unary(code, x)
    function = ca.Function("f", [x, y], [expression])
    for values in ((0.3, 0.7), (0.7, 0.3), (1.5, 2.0), (-0.4, 0.5), (1.0, 1.0)):
        expected = float(function(*values))
        if np.isfinite(expected):
            (value,) = evaluate(expression, [x, y], values)
            assert abs(float(value) - expected) <= 1e-14 * max(1.0, abs(expected)), values
