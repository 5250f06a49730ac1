"""Mutation test: small changes are made to the sources, one at a time, and the tests chosen for the source
must fail.

    python -m noslip.tests.mutation [FILE ...] [--all] [--sample N] [--seed N ...] [--jobs N] [--least PART]
    [--json FILE]

Works on copies of the tree in a temporary folder, one for each job, never on the tree itself. Of each source
a sample of its mutants is run for each seed. A mutant in C that does not compile, or whose optimized code is
that of the source, is none. Mutants that no test can find are listed with the reason in
mutation_equivalent.toml. Exit 1 when fewer than LEAST, or PART, of the others are killed.
"""

from __future__ import annotations

import argparse
import ast
import json
import multiprocessing
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path

from noslip.tests.tools import path_of

ROOT = Path(__file__).resolve().parent.parent
EQUIVALENT = "tests/mutation_equivalent.toml"
LEAST, SEED, SAMPLE = 0.97, 1992, 15
# s of processor time for tests; how often that of the source a mutant may take: an endless loop ends there
MOST, TIMES = 300, 4
FOLDERS = ("runtime_c", "firmware", "generated/labmate")  # of headers
HEAVY = (
    "casadi",
    "cffi",
    "matplotlib.pyplot",
    "mpmath",
    "numpy",
    "pyarrow.parquet",
    "pytest",
    "scipy.integrate",
    "scipy.linalg",
)


@dataclass(frozen=True)
class Source:
    """The tests that are to find what is wrong in a source, as arguments of pytest;
    how many mutants a run tries."""

    tests: tuple[str, ...]
    sample: int = SAMPLE


def _chosen(names: str, words: str) -> tuple[str, ...]:
    """Tests in these files whose names have one of the words, or none of those after `-`."""
    some = [word for word in words.split() if word[0] != "-"]
    none = [f"not {word[1:]}" for word in words.split() if word[0] == "-"]
    expression = " and ".join([*([f"({' or '.join(some)})"] if some else []), *none])
    return (*map(path_of, names.split()), "-k", expression)


_TRIG = _chosen(
    "test_runtime test_odometry test_tracking", "trig_and_roots sinc tanc atan2_against atan2_is angle_of"
)
_PATH = _chosen(
    "test_tracking",
    "against_the_reference never_back several_turns laps crosses passes drift pushed beside cusp profile "
    "smooth errors centre error_on is_an_update null however_far too_many refused not_finite largest_gap "
    "whole_turns tight -casadi",
)
_SHIPPED = "tests/codegen/test_codegen.py::test_shipped_files_are_current"
_CODEGEN = {  # by what else than the shipped C
    "derivation/foot": (
        "test_codegen test_follow test_verify",
        "foot_is_enough labmate who_has no_follow any_shape remembered",
    ),
    "derivation/grip": (
        "test_codegen test_grip test_verify",
        "c_is_the_reference rolls_or_says remembered generate-grip",
    ),
    "derivation/stages": ("test_codegen test_extension", "steps_are singular_is masses c_is_the_model"),
    "derivation/taylor": ("test_codegen test_functions", "derivatives in_a_path"),
    "graph": (
        "test_codegen",
        "equal_expressions simplifying random_graphs random_c powers tangent functions_without any_name",
    ),
    "optimize": ("test_codegen", "random_graphs value_of_laws fewer"),
    "program": (
        "test_codegen test_extension test_damped",
        "steps_are names_stand sincos singular_is c_is_the_model casadi_agree",
    ),
    "printing/law_c": ("test_codegen", "any_name laws_in_c counts_are comments temporaries"),
    "printing/program_c": ("test_codegen", "any_name laws_in_c counts_are comments"),
    "printing/robot_c": ("test_codegen", "any_name names_of laws_in_c"),
    "printing/scalar": ("test_codegen", "literals does_not_fit random_c"),
    "printing/statements": (
        "test_codegen test_large",
        "random_c powers tangent laws_in_c comments temporaries invert no_warn",
    ),
}

SOURCES: Mapping[str, Source] = {
    "runtime_c/noslip_odometry.inc": Source(
        _chosen(
            "test_odometry", "-compiler -warnings -float_side -plant -labmate -rates1 -rates2 -casadi -robots"
        )
    ),
    "runtime_c/noslip_integral.inc": Source(
        _chosen(
            "test_integral",
            "without_a_jump error_counts c_is_the_reference windup wrong_side small_steps time_nothing "
            "left_of new_start refused null way_out",
        )
    ),
    "runtime_c/noslip_controller.inc": Source(
        _chosen(
            "test_limits test_integral test_motor test_odometry",
            "within_the_limits desired written_and slow_by_itself nothing_helps any_size line-cut bad_limits "
            "small_steps time_nothing refused",
        )
    ),
    "runtime_c/noslip_grip.inc": Source(
        _chosen(
            "test_grip",
            "c_is rolls_or given_up least_squares init_checks cone_is_cut way_to steps_keep any_forces "
            "touched",
        )
    ),
    "runtime_c/noslip_shaping.inc": Source(
        _chosen("test_grip", "least_forces used_first c_is any_forces not_touched")
    ),
    "runtime_c/noslip_approach.inc": Source(
        _chosen("test_approach", "bounded at_rest overshoot c_is fastest refused within -specs")
    ),
    "runtime_c/noslip_profile.inc": Source(
        _chosen("test_profile", "fastest refuses repeats derivative cusp slow_line rises")
    ),
    "runtime_c/noslip_slip.inc": Source(
        _chosen("test_slip", "reference false_alarm counts_alone lowered any_bits refused_options grip_of")
    ),
    "runtime_c/noslip_ekf.inc": Source(
        _chosen(
            "test_ekf",
            "50_digits late too_old covariance_are wrong_pose whole_turns init_refuses refused_changes "
            "any_bits range",
        )
    ),
    "runtime_c/noslip_factors.inc": Source(_chosen("test_ekf test_adaptation", "50_digits least_squares")),
    "runtime_c/noslip_adaptation.inc": Source(
        _chosen("test_adaptation", "least_squares forgotten beyond_the_bounds any_bits init_refuses")
    ),
    "runtime_c/noslip_motor.inc": Source(
        _chosen(
            "test_motor test_runtime", "desired continuous leave supply torque misuse finite noslip_motor"
        )
    ),
    "runtime_c/noslip_velocity.inc": Source(
        _chosen(
            "test_drives test_kinematic",
            "c_is any_bits_in_l any_bits_of stop_together blocked keep_the misuse follow_is accelerations_of "
            "too_fast what_a_step -car -manip -wheel -slope",
        )
    ),
    "runtime_c/noslip_reversing.inc": Source(_chosen("test_odometry", "reversing")),
    "runtime_c/noslip_angle.inc": Source(_chosen("test_outer_loop", "nearest_angle")),
    "runtime_c/noslip_solve.inc": Source(_chosen("test_large", "runtimes no_inverse")),
    "runtime_c/noslip_path.inc": Source(_PATH),
    "runtime_c/noslip_path_code.inc": Source(_PATH),
    "runtime_c/noslip_trig.h": Source(_TRIG),
    **{
        f"runtime_c/noslip_functions.{kind}": Source(
            _chosen("test_runtime test_functions", "trig_and_roots kinks")
        )
        for kind in ("h", "inc")
    },
    "runtime_c/noslip_real.h": Source(
        _chosen("test_runtime test_odometry", "trig_and_roots finite overflows refused_numbers add_up")
    ),
    "runtime_c/noslip_watchdog.c": Source(_chosen("test_firmware", "watchdog stuck stop missed null")),
    "generated/labmate/labmate_follower_f.c": Source(
        _chosen(
            "test_firmware test_follower",
            "zeros together are_counts law_says far_from approach update settings null wheel_rates width "
            "stands_where recursion misread missed too_long stops resets forgets sees stuck integral "
            "left_out keep_grip limited_and same_point one_motor not_driven wide_enough",
        )
    ),
    **{
        f"codegen/{name}.py": Source((_SHIPPED, *_chosen(names, f"shipped_files {words}")), 8)
        for name, (names, words) in _CODEGEN.items()
    },
}


@dataclass(frozen=True)
class Mutant:
    """A change of one place of a text."""

    start: int
    end: int
    new: str

    def of(self, text: str) -> str:
        """The changed text."""
        return text[: self.start] + self.new + text[self.end :]

    def lines(self, text: str) -> tuple[str, str]:
        """The changed lines before and after, without indentation."""
        first, last = text.rfind("\n", 0, self.start) + 1, text.find("\n", self.end)
        last = len(text) if last < 0 else last
        return text[first:last].strip(), (text[first : self.start] + self.new + text[self.end : last]).strip()


# -- mutants of C --------------------------------------------------------------------------------------------

OPPOSITE = {
    "<": ("<=", ">="),
    ">": (">=", "<="),
    "<=": ("<", ">"),
    ">=": (">", "<"),
    "==": ("!=",),
    "!=": ("==",),
}
EXCHANGED = {
    **{
        "+": "-",
        "-": "+",
        "*": "/",
        "/": "*",
        "%": "*",
        "&&": "||",
        "||": "&&",
        "&": "|",
        "|": "&",
        "<<": ">>",
        ">>": "<<",
    },
    **{"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "|=": "&=", "<<=": ">>="},
}
COMMENT = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"', re.DOTALL)
OPERATOR = re.compile(r"(?<=\s)([-+*/%<>=!&|]{1,3})(?=\s)")
NUMBER = re.compile(r"(?<![\w.])(0x[0-9a-fA-F]+|\d+\.?\d*(?:[eE][-+]?\d+)?)([uUfFlL]*)(?![\w.])")
MINUS = re.compile(r"(?:(?<=[=,?:<>&|+*/-] )|(?<=return )|(?<=[({)]))-(?=[\w(])")
NOT = re.compile(r"!(?=[\w(])")
CONDITION = re.compile(r"\bif (?=\()")
STATEMENT = re.compile(
    r"(?<=[;{}])(\s+)((?!return|break|continue|typedef|for|if|do|else|while)[\w(*+-][^;{}]*;)(?=\s)"
)
DECLARED = re.compile(r"\b(?:NOSLIP_REAL|float|double|u?int\w*|NOSLIP_NAME\(\w+\))\s[\w\s,*\[\]]*?\w$")


def c_mutants(text: str, active: set[int]) -> list[Mutant]:
    """All mutants of a text of C in the lines that are compiled, from 1."""
    code = COMMENT.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)
    code = re.sub(
        r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*",
        lambda found: re.sub(r"[^\n]", " ", found[0]),
        code,
        flags=re.MULTILINE,
    )
    return [mutant for mutant in _c_mutants(code) if code.count("\n", 0, mutant.start) + 1 in active]


def _c_mutants(code: str) -> Iterator[Mutant]:
    for found in OPERATOR.finditer(code):
        for new in OPPOSITE.get(found[0], (EXCHANGED[found[0]],) if found[0] in EXCHANGED else ()):
            yield Mutant(*found.span(), new)
    for found in NUMBER.finditer(code):
        line = code[code.rfind("\n", 0, found.start()) + 1 : found.start()]
        if line[-1:] != "[" or not DECLARED.search(line[:-1]):
            yield Mutant(
                *found.span(),
                f"(2 * {found[0]})" if "." in found[1] or "e-" in found[1] else f"({found[0]} + 1)",
            )
    for pattern in (MINUS, NOT):
        for found in pattern.finditer(code):
            yield Mutant(*found.span(), "")
    for found in CONDITION.finditer(code):
        end = _closing(code, found.end())
        for always in ("0 && ", "1 || "):
            yield Mutant(found.end(), end, f"({always}{code[found.end() : end]})")
    for found in STATEMENT.finditer(code):
        yield Mutant(*found.span(2), ";")


def _closing(code: str, start: int) -> int:
    depth = 0
    for k in range(start, len(code)):
        depth += (code[k] == "(") - (code[k] == ")")
        if depth == 0:
            return k + 1
    raise ValueError("a parenthesis is not closed")


def _units(path: str) -> list[str]:
    """What compiles a source in C: texts of translation units."""
    name = Path(path).name
    if name.endswith("_code.inc"):
        base = name.removesuffix("_code.inc")
        return [f'#include "{base}{suffix}.c"\n' for suffix in ("", "_f")]
    return [f'#include "{name.removesuffix(".inc") + ".h" if name.endswith(".inc") else name}"\n']


def _compiled(root: Path, path: str, *flags: str) -> str | None:
    """What the compiler makes of a source with these flags; None where it refuses."""
    command = [
        "cc",
        "-std=c99",
        "-ffp-contract=off",
        "-fno-math-errno",
        *(f"-I{root / folder}" for folder in FOLDERS),
    ]
    made = []
    for unit in _units(path):
        done = subprocess.run(
            [*command, *flags, "-x", "c", "-o", "-", "-"], input=unit, capture_output=True, text=True
        )
        if done.returncode:
            return None
        made.append(done.stdout)
    return "\n".join(made)


def _optimized(root: Path, path: str) -> str | None:
    return _compiled(root, path, "-w", "-O2", "-S", "-fkeep-inline-functions")


def _is_c(root: Path, path: str) -> bool:
    return _compiled(root, path, "-w", "-fsyntax-only") is not None


def _active(root: Path, path: str) -> set[int]:
    """Numbers of the lines that the compiler sees on this host."""
    seen, here, number = set(), False, 0
    for line in (_compiled(root, path, "-E") or "").splitlines():
        if marker := re.match(r'# (\d+) "(.*?)"', line):
            number, here = int(marker[1]), Path(marker[2]).name == Path(path).name
            continue
        if here and line.strip():
            seen.add(number)
        number += 1
    return seen


# -- mutants of Python ---------------------------------------------------------------------------------------

PYTHON = {
    **{ast.Lt: ("<=", ">="), ast.LtE: ("<", ">"), ast.Gt: (">=", "<="), ast.GtE: (">", "<"), ast.Eq: ("!=",)},
    **{ast.NotEq: ("==",), ast.In: ("not in",), ast.NotIn: ("in",), ast.Is: ("is not",), ast.IsNot: ("is",)},
    **{
        ast.Add: ("-",),
        ast.Sub: ("+",),
        ast.Mult: ("/",),
        ast.Div: ("*",),
        ast.FloorDiv: ("*",),
        ast.Mod: ("*",),
    },
    **{ast.And: ("or",), ast.Or: ("and",), ast.Pow: ("*",), ast.BitAnd: ("|",), ast.BitOr: ("&",)},
}
TOKEN = re.compile(r"(?:is not|not in|[-+*/%<>=!&|]+|is|in|and|or)(?![\w])|[-+*/%<>=!&|]+")


def python_mutants(text: str) -> list[Mutant]:
    """All mutants of a text of Python; annotations and strings stay as they are."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    lines = text.splitlines(keepends=True)

    def at(line: int, column: int) -> int:
        return starts[line - 1] + len(lines[line - 1].encode()[:column].decode())

    def span(node: ast.AST) -> tuple[int, int]:
        return at(node.lineno, node.col_offset), at(node.end_lineno, node.end_col_offset)

    def between(left: ast.AST, right: ast.AST, kind: ast.AST) -> Iterator[Mutant]:
        start, end = span(left)[1], span(right)[0]
        found = TOKEN.search(text, start, end)
        if found and type(kind) in PYTHON:
            for new in PYTHON[type(kind)]:
                yield Mutant(*found.span(), new)

    def visit(node: ast.AST) -> Iterator[Mutant]:
        if isinstance(node, ast.Compare):
            for left, kind, right in zip(
                [node.left, *node.comparators], node.ops, node.comparators, strict=False
            ):
                yield from between(left, right, kind)
        elif isinstance(node, ast.BinOp):
            yield from between(node.left, node.right, node.op)
        elif isinstance(node, ast.BoolOp):
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from between(left, right, node.op)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            yield Mutant(span(node)[0], span(node.operand)[0], "")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield Mutant(*span(node), f"({text[slice(*span(node))]} + 1)")
        elif isinstance(node, ast.Constant) and type(node.value) is bool:
            yield Mutant(*span(node), str(not node.value))
        elif isinstance(node, ast.If | ast.IfExp | ast.While):
            test = text[slice(*span(node.test))]
            yield Mutant(*span(node.test), f"(not ({test}))")
        elif isinstance(node, ast.Assign | ast.AugAssign | ast.Raise) or (
            isinstance(node, ast.Expr) and not isinstance(node.value, ast.Constant)
        ):
            yield Mutant(*span(node), "pass")
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "type_params") or isinstance(node, ast.JoinedStr):
                continue
            if isinstance(node, ast.keyword) and node.arg in ("strict", "frozen"):
                continue  # they assert that two are as long, and that nothing is assigned
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from visit(child)

    return list(visit(ast.parse(text)))


# -- the runs ------------------------------------------------------------------------------------------------


def mutants(root: Path, path: str) -> list[Mutant]:
    """All mutants of a source."""
    text = (root / path).read_text()
    return python_mutants(text) if path.endswith(".py") else c_mutants(text, _active(root, path))


def equivalent(root: Path) -> dict[str, set[tuple[str, str]]]:
    """Mutants that no test can find: source -> lines before and after."""
    file = root / EQUIVALENT
    listed = tomllib.loads(file.read_text()) if file.exists() else {}
    return {
        path: {(entry["before"], entry["after"]) for entry in entries} for path, entries in listed.items()
    }


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant."""

    path: str
    line: int
    before: str
    after: str
    end: str  # "killed", "survived", or "equivalent", if its code or what is listed says so

    def __str__(self) -> str:
        return f"{self.path}:{self.line}\n  - {self.before}\n  + {self.after}"


def files_of(root: Path) -> list[str]:
    """All files of a tree that git has or would take; of one without git, all."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=root, capture_output=True, text=True
    )
    names = (
        listed.stdout.splitlines()
        if listed.returncode == 0
        else [str(p.relative_to(root)) for p in root.rglob("*")]
    )
    return sorted({name for name in names if (root / name).is_file()})


class NotReady(Exception):
    """The tests of a source do not pass as it is."""


class QuickestFirst:
    """A plugin of pytest: the tests that took the least time when nothing was mutated run first, as nearly
    any test finds a mutant. Those of a file and of a function stay together: they share what is compiled.

    `file` keeps their durations, s.
    """

    def __init__(self, file: Path, mutated: bool):
        self.file, self.mutated, self.seconds = file, mutated, Counter[str]()

    def pytest_collection_modifyitems(self, items: list) -> None:
        known = json.loads(self.file.read_text()) if self.mutated else {}
        items.sort(key=lambda item: [known.get(name, 0.0) for name in self._groups(item.nodeid)])

    def pytest_runtest_logreport(self, report) -> None:
        self.seconds.update(dict.fromkeys(self._groups(report.nodeid), report.duration))

    def pytest_sessionfinish(self) -> None:
        if not self.mutated:
            self.file.write_text(json.dumps(self.seconds))

    @staticmethod
    def _groups(name: str) -> tuple[str, str, str]:
        """Return the file of a test, its function and itself."""
        return name.split("::")[0], name.split("[")[0], name


class Copy:
    """A copy of the tree in a folder of its own, where mutants are tried one after the other."""

    def __init__(self, root: Path, folder: Path):
        self.tree, self.folder, self.most = folder / "noslip", folder, MOST
        for name in files_of(root):
            (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, self.tree / name)
        self.compiler = folder / "cc"
        self.compiler.write_text('#!/bin/sh\nexec cc "$@" -O0\n')  # the last level counts
        self.compiler.chmod(0o700)

    def passes(self, tests: tuple[str, ...], mutated: bool = True) -> float:
        """Processor time (s) of the tests in a process of its own, which has what is not noslip's already;
        0 where they fail. Bytecode is written only where nothing is mutated, and read everywhere: that of a
        mutated file does not count, as it has another time."""
        child = os.fork()
        if child == 0:
            os._exit(self._pytest(tests, mutated))
        _, status, used = os.wait4(child, 0)
        return 0.0 if status else used.ru_utime + used.ru_stime

    def _pytest(self, tests: tuple[str, ...], mutated: bool) -> int:
        resource.setrlimit(resource.RLIMIT_CPU, (self.most, self.most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        log = os.open(self.folder / "log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.chdir(self.tree)
        for name in [name for name in sys.modules if name.split(".")[0] == "noslip"]:
            del sys.modules[name]
        sys.path.insert(0, str(self.folder))
        os.environ |= {
            "PYTHONPATH": str(self.folder),
            "PYTHONDONTWRITEBYTECODE": "1" if mutated else "",
            "NOSLIP_CACHE": str(self.folder / "cache"),
            "CC": str(self.compiler),
            "OPENBLAS_NUM_THREADS": "1",
        }
        sys.dont_write_bytecode = mutated
        more = ["-x", "-q", "-p", "no:cacheprovider", "-n", "0", f"--basetemp={self.folder / 'tmp'}"]
        order = QuickestFirst(self.folder / "seconds.json", mutated)
        return int(import_module("pytest").main([*tests, *more], plugins=[order]))

    def kept(self) -> set[Path]:
        """What has been compiled."""
        cache = self.folder / "cache"
        return set(cache.iterdir()) if cache.exists() else set()

    def outcomes(
        self, path: str, source: Source, everything: bool, sample: int, seeds: Sequence[int]
    ) -> list[Outcome]:
        """Tries samples of the mutants of a source; prints who survives. Raises NotReady where its tests fail
        without them."""
        file = self.tree / path
        text, listed, python = file.read_text(), equivalent(self.tree).get(path, set()), path.endswith(".py")
        self.most = MOST
        if not (took := self.passes(source.tests, mutated=False)):
            raise NotReady(f"{path}: its tests fail: {(self.folder / 'log').read_text()[-2000:]}")
        self.most = int(10 + TIMES * took)
        compiled, found, tried = self.kept(), {}, 0
        plain = None if python else _optimized(self.tree, path)
        for mutant, most in _drawn(
            mutants(self.tree, path), path, seeds, 0 if everything else sample or source.sample
        ):
            if tried >= most or mutant in found:
                continue
            before, after = mutant.lines(text)
            place = path, text.count("\n", 0, mutant.start) + 1, before, after
            if (before, after) in listed:
                found[mutant] = Outcome(*place, "equivalent")
                continue
            (self.tree / path).write_text(mutant.of(text))
            if python or _is_c(self.tree, path):
                end = "survived" if self.passes(source.tests) else "killed"
                if end == "survived" and not python and _optimized(self.tree, path) == plain:
                    end = "equivalent"
                tried += end != "equivalent"
                found[mutant] = Outcome(*place, end)
                if end == "survived":
                    print(f"survived: {found[mutant]}", flush=True)
            (self.tree / path).write_text(text)
            for new in self.kept() - compiled:
                new.unlink()
        return list(found.values())


def _drawn(made: list[Mutant], path: str, seeds: Sequence[int], sample: int) -> Iterator[tuple[Mutant, int]]:
    """The mutants of a source in the order of each seed, and how many are to be tried up to this seed;
    of 0, all."""
    for k, seed in enumerate(seeds, 1):
        for mutant in random.Random(f"{seed} {path}").sample(made, len(made)):
            yield mutant, k * sample or len(made)


@cache
def _copy(root: Path, folder: Path, ready: tuple[str, ...]) -> Copy:
    """The copy of this process, which has imported what tests use."""
    for name in ready:
        import_module(name)
    return Copy(root, Path(tempfile.mkdtemp(dir=folder)))


def _outcomes(task: tuple) -> list[Outcome] | str:
    root, folder, ready, *rest = task
    try:
        return _copy(root, folder, ready).outcomes(*rest)
    except NotReady as error:
        return str(error)


def run(
    root: Path,
    sources: Mapping[str, Source],
    everything=False,
    sample=0,
    seeds=(SEED,),
    jobs=2,
    ready=HEAVY,
    least=LEAST,
    out=None,
) -> int:
    """Tries mutants of the sources, says which survive and the scores; 0 where enough are killed.

    `ready`: modules that are imported once for all; `out`: a file for the numbers as JSON, in all and by
    source.
    """
    counts = {}
    # When a worker is stopped, the tests that it runs may still write.
    scratch = tempfile.TemporaryDirectory(prefix="mutation", ignore_cleanup_errors=True)
    with scratch as folder, ProcessPoolExecutor(jobs, multiprocessing.get_context("fork")) as pool:
        tasks = [
            (root, Path(folder), ready, path, source, everything, sample, seeds)
            for path, source in sources.items()
        ]
        for (path, _), found in zip(sources.items(), pool.map(_outcomes, tasks), strict=True):
            if isinstance(found, str):
                print(found)
                # Waits for what runs: a worker that is stopped may hold a lock
                pool.shutdown(cancel_futures=True)
                return 2
            ends = [outcome.end for outcome in found]
            own = counts[path] = {end: ends.count(end) for end in ("killed", "equivalent", "survived")}
            print(f"{path}: {own['killed']} of {own['killed'] + own['survived']} killed", flush=True)
    totals = {end: sum(own[end] for own in counts.values()) for end in ("killed", "equivalent", "survived")}
    killed, total = totals["killed"], totals["killed"] + totals["survived"]
    print(f"{killed} of {total} killed, {killed / max(total, 1):.1%}")
    if out:
        Path(out).write_text(json.dumps({**totals, "files": counts}))
    return 0 if killed >= least * total else 1


def main() -> int:
    parser = argparse.ArgumentParser(
        description="changes the sources a little and looks whether the tests fail"
    )
    parser.add_argument("file", nargs="*", help="sources, as in SOURCES (all)")
    parser.add_argument("--all", action="store_true", help="every mutant of each")
    parser.add_argument("--sample", type=int, default=0, help="mutants of each (as in SOURCES)")
    parser.add_argument("--seed", type=int, nargs="+", default=[SEED], dest="seeds")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--least", type=float, default=LEAST, metavar="PART", help=f"that must be killed ({LEAST:g})"
    )
    parser.add_argument("--json", metavar="FILE", help="where the numbers go")
    given = parser.parse_args()
    if unknown := [path for path in given.file if path not in SOURCES]:
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(SOURCES)}")
    chosen = {path: SOURCES[path] for path in given.file or SOURCES}
    return run(
        ROOT, chosen, given.all, given.sample, given.seeds, given.jobs, least=given.least, out=given.json
    )


if __name__ == "__main__":
    sys.exit(main())
