"""How much of its tolerance each comparison of the tests needs: `pytest --margins FILE`.

A test whose numbers fill their tolerance passes on one processor and fails on the next. With this option
every comparison with a tolerance is measured while the tests run as usual, and the run fails where one needs
more than a tenth of what it allows. Measured are `pytest.approx`, `assert_allclose`, `allclose`, `isclose`,
and `<` or `<=` in an assertion whose right side contains a tolerance: a number written with a negative
exponent (1e-9), or a name for such a number.

The right side of a comparison is an expression R in its tolerances, for example `1 + 1e-9` or
`TOLERANCE * size`. It is evaluated with the tolerances times 0 and times 1, and the part that the left side
needs is (left - R(0)) / (R(1) - R(0)). Bounds that are not tolerances (`slip < 0.01`, in m/s) are written
without an exponent.
"""

from __future__ import annotations

import ast
import builtins
import json
import math
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from _pytest.assertion import rewrite
from _pytest.python_api import ApproxScalar

ALLOWED = 0.1  # the part of a tolerance that a comparison may need
NAMED = re.compile(r"toleranc|^tol$", re.IGNORECASE)
TESTS = Path(__file__).parent
# Files whose functions compare for their caller
COMPARE = rf"{re.escape(__file__)}$|/_pytest/|/numpy/|/contextlib"
# Test -> place of a comparison -> largest part of its tolerance needed
needed: dict[str, dict[str, float]] = {}
test = ""  # that runs now


class Scaled(ast.NodeTransformer):
    """Multiplies the tolerances in an expression by the variable `scale`; counts them."""

    def __init__(self, names: set[str], is_tolerance: Callable[[ast.AST], bool]) -> None:
        self.names, self.is_tolerance, self.count = names, is_tolerance, 0

    def visit(self, node: ast.AST) -> ast.AST:
        """Replace a tolerance by its product with `scale`."""
        base = node.value if isinstance(node, ast.Subscript) else node
        if self.is_tolerance(node) or isinstance(base, ast.Name) and base.id in self.names:
            self.count += 1
            return ast.BinOp(node, ast.Mult(), ast.Name("scale", ast.Load()))
        return self.generic_visit(node)


class Measured(ast.NodeTransformer):
    """Has the comparisons with tolerances in assertions measured."""

    def __init__(self, source: bytes, path: str) -> None:
        self.lines, self.path, self.inside = source.splitlines(), Path(path).name, False
        self.names: set[str] = set()

    def is_tolerance(self, node: ast.AST) -> bool:
        """Return whether a node is a number that is written with a negative exponent."""
        if (
            not (isinstance(node, ast.Constant) and isinstance(node.value, float))
            or node.lineno != node.end_lineno
        ):
            return False
        return b"e-" in self.lines[node.lineno - 1][node.col_offset : node.end_col_offset]

    def only_tolerances(self, node: ast.AST) -> bool:
        """Return whether an expression is a tolerance, or a table, a tuple or a choice of tolerances."""
        match node:
            case ast.Dict(values=values) | ast.Tuple(elts=values) | ast.List(elts=values):
                return bool(values) and all(map(self.only_tolerances, values))
            case ast.IfExp(body=body, orelse=other):
                return self.only_tolerances(body) and self.only_tolerances(other)
        return self.is_tolerance(node)

    def find_names(self, tree: ast.AST) -> None:
        """Find the names of tolerances."""
        for node in ast.walk(tree):
            pairs: list[tuple[ast.AST, ast.AST]] = []
            match node:
                case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                    pairs = list(zip(names, values, strict=False))
                case ast.Assign(targets=[name], value=value):
                    pairs = [(name, value)]
                case ast.Name(id=name) if NAMED.search(name):
                    self.names.add(name)
            self.names |= {
                name.id for name, value in pairs if isinstance(name, ast.Name) and self.only_tolerances(value)
            }

    def visit_Assert(self, node: ast.Assert) -> ast.AST:
        """Look at the comparisons of an assertion."""
        self.inside = True
        node.test = self.visit(node.test)
        self.inside = False
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Replace `left < right` by a call that measures it."""
        self.generic_visit(node)
        if not self.inside or len(node.ops) > 1 or not isinstance(node.ops[0], ast.Lt | ast.LtE):
            return node
        right = node.comparators[0]
        if any(isinstance(part, ast.NamedExpr | ast.Await | ast.Yield) for part in ast.walk(right)):
            return node
        scaled = Scaled(self.names, self.is_tolerance)
        of_scale = ast.Lambda(
            ast.arguments([], [ast.arg("scale")], None, [], [], None, []), scaled.visit(right)
        )
        if not scaled.count:
            return node
        call = ast.Call(
            ast.Name("measured_comparison", ast.Load()),
            [
                node.left,
                of_scale,
                ast.Constant(isinstance(node.ops[0], ast.Lt)),
                ast.Constant(f"{self.path}:{node.lineno}"),
            ],
            [],
        )
        return ast.fix_missing_locations(ast.copy_location(call, node))


def note(place: str, part: float) -> None:
    """Keep the largest part of a tolerance that a test needs at a place."""
    if not place:
        return
    places = needed.setdefault(test, {})
    places[place] = max(places.get(place, 0.0), part)


def measured_comparison(left: Any, right: Callable[[float], Any], strict: bool, place: str) -> Any:
    """Return left < right(1), or left <= right(1), and note the part of the tolerance that is needed where it
    holds."""
    limit = right(1.0)
    holds = left < limit if strict else left <= limit
    with np.errstate(all="ignore"):
        at_zero = right(0.0)
    try:
        value, exact, allowed = (np.asarray(part, float) for part in (left, at_zero, limit))
    except (TypeError, ValueError):  # numbers of another kind, such as mpmath's
        value, exact, allowed = (np.asarray(part, object) for part in (left, at_zero, limit))
    if np.all(holds):
        with np.errstate(all="ignore"):
            part = np.atleast_1d((value - exact) / (allowed - exact)).astype(float)
        note(place, float(np.max(part[np.isfinite(part)], initial=0.0)))
    return holds


def place_of_caller() -> str:
    """Return the place in the tests from which the present comparison is called;
    empty if the product or a library calls it."""
    frame: FrameType | None = sys._getframe(2)
    while frame and re.search(COMPARE, frame.f_code.co_filename):
        frame = frame.f_back
    if frame is None or Path(frame.f_code.co_filename).parent != TESTS:
        return ""
    return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"


def approx_measured(self: ApproxScalar, actual: Any) -> bool:
    """Return what pytest's own comparison does, and note the part of the tolerance that is needed."""
    equal = approx_of_pytest(self, actual)
    numbers = isinstance(actual, float | np.floating) and isinstance(self.expected, int | float | np.number)
    if equal and numbers and math.isfinite(actual) and self.tolerance:
        note(place_of_caller(), float(abs(actual - self.expected) / self.tolerance))
    return equal


approx_of_pytest = ApproxScalar.__eq__


def close_measured(close: Callable[..., Any], relative: float, absolute: float) -> Callable[..., Any]:
    """Return a function like `np.allclose` that also notes the part of the tolerance that is needed.

    `relative`, `absolute`: its tolerances unless they are stated.
    """

    def measured(actual: Any, desired: Any, *more: Any, **options: Any) -> Any:
        answer = close(actual, desired, *more, **options)
        rtol, atol = (*more, *(None, None)[len(more) :])[:2]
        names = ("rel_tol", "abs_tol") if close is math.isclose else ("rtol", "atol")
        rtol = options.get(names[0], relative) if rtol is None else rtol
        atol = options.get(names[1], absolute) if atol is None else atol
        if answer is None or np.all(answer):
            with np.errstate(all="ignore"):
                error = np.abs(np.subtract(actual, desired, dtype=complex))
                part = np.atleast_1d(error / (atol + rtol * np.abs(np.asarray(desired, complex))))
            note(place_of_caller(), float(np.max(part[np.isfinite(part)], initial=0.0)))
        return answer

    return measured


class Margins:
    """The plugin of a process: measures; the one that started the others writes the file and judges."""

    def __init__(self, path: Path) -> None:
        self.path, self.patch = path, pytest.MonkeyPatch()
        measure = rewrite.rewrite_asserts

        def rewritten(
            tree: ast.Module, source: bytes, module_path: str | None = None, config: Any = None
        ) -> None:
            measured = Measured(source, module_path or "")
            measured.find_names(tree)
            measured.visit(tree)
            measure(tree, source, module_path, config)

        self.patch.setattr(rewrite, "rewrite_asserts", rewritten)
        # What is compiled without this plugin does not measure
        self.patch.setattr(rewrite, "_read_pyc", lambda *_, **__: None)
        self.patch.setattr(sys, "dont_write_bytecode", True)
        self.patch.setattr(builtins, "measured_comparison", measured_comparison, raising=False)
        self.patch.setattr(ApproxScalar, "__eq__", approx_measured)
        self.patch.setattr(
            np.testing, "assert_allclose", close_measured(np.testing.assert_allclose, 1e-7, 0.0)
        )
        self.patch.setattr(np, "allclose", close_measured(np.allclose, 1e-5, 1e-8))
        self.patch.setattr(np, "isclose", close_measured(np.isclose, 1e-5, 1e-8))
        self.patch.setattr(math, "isclose", close_measured(math.isclose, 1e-9, 0.0))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Know which test runs."""
        global test
        test = item.nodeid
        return (yield)

    def pytest_testnodedown(self, node: Any) -> None:
        """Take over what a process of pytest-xdist has measured."""
        needed.update(getattr(node, "workeroutput", {}).get("margins", {}))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Hand over what was measured, or write it and judge."""
        self.patch.undo()
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["margins"] = needed
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        worst = {test: dict(sorted(places.items())) for test, places in sorted(needed.items())}
        self.path.write_text(json.dumps(worst, indent=1) + "\n", encoding="utf-8")
        if too_close(needed) and session.exitstatus == 0:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Print the closest comparisons, a line each."""
        places = by_place(needed)
        close = too_close(needed)
        terminalreporter.section("margins")
        for place, part in list(close.items()) or list(places.items())[:10]:
            terminalreporter.write_line(f"{place}: {part:.3g} of its tolerance")
        terminalreporter.write_line(
            f"{len(places)} comparisons; {len(close)} need more than {ALLOWED} of their tolerance"
        )


def by_place(of_tests: dict[str, dict[str, float]]) -> dict[str, float]:
    """Return the largest part that each place needs, the largest first."""
    places: dict[str, float] = {}
    for parts in of_tests.values():
        for place, part in parts.items():
            places[place] = max(places.get(place, 0.0), part)
    return dict(sorted(places.items(), key=lambda entry: -entry[1]))


def too_close(of_tests: dict[str, dict[str, float]]) -> dict[str, float]:
    """Return the places that need more than is allowed."""
    return {place: part for place, part in by_place(of_tests).items() if part > ALLOWED}
