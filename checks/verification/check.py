"""Compares the generated C with the symbolic reference, and both with expected values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...readers.errors import BadInput
from ...readers.printing import columns, plain
from ...readers.progress import Reported, silent
from ...simulation.controllers.backends import SCALAR, make_controller
from ...simulation.controllers.controller import MODEL_QUANTITIES, QUANTITIES, Evaluation
from .evaluate import evaluate_cases

if TYPE_CHECKING:
    from ...model.law import ControlLaw
    from ...simulation.specification.cases import EvaluationCase

SMALLEST = 1e-3  # errors are relative to the largest entry of the quantity, but at least to this (SI)
MOST_STATES = 10_000_000
# At random states at least to this part of the median size of the quantity: some entries cancel there
TYPICAL = 0.1
FEW = 16  # the median of fewer errors is shown but has no limit, because it is not significant


@dataclass(frozen=True)
class ErrorLimits:
    """Largest error allowed, in the worst case and in the median."""

    worst: float
    median: float = float("inf")

    def __str__(self) -> str:
        return f"{self.worst:g}" + (f", median {self.median:g}" if np.isfinite(self.median) else "")


EXPECT_LIMITS = {"casadi": ErrorLimits(1e-12), "c": ErrorLimits(1e-11), "cf": ErrorLimits(1e-4, 2e-6)}
RANDOM_LIMITS = {"c": ErrorLimits(1e-11), "cf": ErrorLimits(1e-4, 1e-6)}  # c against casadi, cf against c


@dataclass(frozen=True)
class ErrorSummary:
    """The errors of one quantity over many cases; `where` is the case of the worst one."""

    worst: float
    median: float
    where: str
    count: int

    def within(self, limits: ErrorLimits) -> bool:
        """Return whether both are at or below the limits; the median only if there are at least FEW
        errors."""
        return self.worst <= limits.worst and (self.median <= limits.median or self.count < FEW)


@dataclass(frozen=True)
class Deviation:
    """Largest difference between the entries of a quantity and those expected,
    the largest entry expected, and the case."""

    difference: float
    size: float
    where: str


Deviations = dict[str, list[Deviation]]  # by quantity


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison: its values, its table as text,
    and a line for each error above its limit."""

    values: dict[str, Any]
    table: str
    failures: Sequence[str]

    def as_json(self) -> dict[str, Any]:
        """Return all values, `ok` if no error exceeds its limit, and the failures."""
        return {"ok": not self.failures, **self.values, "failures": list(self.failures)}

    def text(self) -> str:
        """Return the table and the conclusion."""
        above = "\n  ".join(["errors above the limits:", *self.failures])
        return f"{self.table}\n{above if self.failures else 'all errors are within the limits'}"


def check_files(paths: Sequence[str], backends: Sequence[str]) -> Comparison:
    """Compare backends with the expected values of files of cases. Raises BadInput for a file without any."""
    from ...simulation.specification.cases import read_cases

    files = [(path, read_cases(path)) for path in paths]
    failures, answers, tables = [], [], []
    for path, cases in files:
        if not any(case.expect for case in cases):
            raise BadInput(f"{path}: nothing to compare: no case has `expect`")
        table = {backend: summarized(_against_expected(cases, backend), typical=0.0) for backend in backends}
        answers.append({"file": path, "cases": len(cases), "backends": plain(table)})
        failures += [
            line
            for backend, rows in table.items()
            for line in _exceeded(backend, rows, EXPECT_LIMITS[backend])
        ]
        tables.append(
            f"{path}: {len(cases)} cases, error relative to the largest entry of each quantity: worst "
            "(median)\n"
        )
        tables.append(_file_table(cases, table))
    return Comparison({"files": answers}, "\n".join(tables), failures)


def _against_expected(cases: Sequence[EvaluationCase], backend: str) -> Deviations:
    """Return the deviations of the quantities of a backend;
    infinite if a case with expected values cannot be evaluated."""
    deviations: Deviations = {}
    offered = (*QUANTITIES, *MODEL_QUANTITIES) if backend == "casadi" else QUANTITIES
    for case, evaluation in zip(cases, evaluate_cases(cases, backend), strict=True):
        for name, expected in case.expect.items():
            if name not in offered:
                continue
            of_name = deviations.setdefault(name, [])
            if evaluation.status != "ok":
                of_name.append(Deviation(float("inf"), 0.0, f"{case.where} (status {evaluation.status})"))
                continue
            value = evaluation.values[name]
            if expected.shape != value.shape:
                raise BadInput(
                    f"{case.where}: expect.{name} has shape {list(expected.shape)}; it must be "
                    f"{list(value.shape)}"
                )
            of_name.append(deviation_of(value, expected, case.where))
    return deviations


def _file_table(cases: Sequence[EvaluationCase], table: dict[str, dict[str, ErrorSummary]]) -> str:
    rows = [["", *table]]
    expected = {name for case in cases for name in case.expect}
    for name in (*QUANTITIES, *MODEL_QUANTITIES):
        if name in expected:
            cells = [summaries.get(name) for summaries in table.values()]
            rows.append([name, *(f"{s.worst:.1e} ({s.median:.1e})" if s else "-" for s in cells)])
    rows.append(["limit", *(_limit_cell(EXPECT_LIMITS[backend]) for backend in table)])
    return "".join(f"  {line.rstrip()}\n" for line in columns(rows))


def _limit_cell(limits: ErrorLimits) -> str:
    median = f"({limits.median:.1e})" if np.isfinite(limits.median) else " " * len("(1.0e-00)")
    return f"{limits.worst:.1e} {median}"


def check_random(
    robot: str,
    only: str | None,
    states: int,
    seed: int,
    backends: Sequence[str],
    progress: Reported = silent,
) -> Comparison:
    """Compare backends at random states, for the laws of a robot or only one; with
    `progress` of the laws compared. Raises BadInput, ModelError.
    """
    from ...readers.robots import find_laws, find_robot, law_of, system_of

    system = system_of(find_robot(robot))
    names = [only] if only else find_laws(system)
    if not names:
        raise BadInput(
            f"{robot}: this robot can have none of the laws; name one with --output LAW to see why"
        )
    laws = [law_of(system, name) for name in names]
    tables, failures, left_out = {}, [], []
    for k, law in enumerate(laws):
        progress(k, len(laws), "laws compared")
        tables[law.name], ill = _compare(law, states, seed, backends)
        left_out += [f"{law.name}, {line}" for line in ill]
    for name, table in tables.items():
        for backend, summaries in table.items():
            failures += _exceeded(f"{name}, {backend}", summaries, RANDOM_LIMITS[backend])
    compared = ", ".join(dict.fromkeys(name for law in laws for name in law.quantities))
    head = f"{robot}: {states} random states per law, seed {seed}; {compared} compared\n"
    values = {"robot": robot, "states": states, "seed": seed, "laws": plain(tables), "left_out": left_out}
    note = "".join(f"  {line}\n" for line in left_out)
    note = (
        f"\nleft out, because the model itself changes as much where its inputs are rounded:\n{note}"
        if note
        else ""
    )
    return Comparison(values, f"{head}\n{_random_table(tables, backends)}{note}", failures)


def _compare(
    law: ControlLaw, states: int, seed: int, backends: Sequence[str]
) -> tuple[dict[str, dict[str, ErrorSummary]], list[str]]:
    """Compare c with casadi, and cf with c, both at numbers representable in float;
    also return what is left out."""
    from .sampling import as_held, random_plants

    deviations: dict[str, Deviations] = {backend: {} for backend in backends}
    inputs: dict[str, list[Sequence[np.ndarray]]] = {backend: [] for backend in backends}
    for plant in random_plants(law, states, seed):
        for backend in backends:
            scalar = SCALAR[backend]
            numbers = [as_held(group, scalar) for group in (plant.params, plant.config, plant.gains)]
            params, config, gains = numbers
            ours = make_controller(backend, law, params, config, gains)
            double = make_controller("c", law, params, config, gains)
            for point in plant.points:
                at = as_held(point.state, scalar), as_held(point.reference, scalar)
                truth = double.evaluate(*at) if backend == "cf" else point.truth
                _add(deviations[backend], law.quantities, ours.evaluate(*at), truth, f"state {point.number}")
                inputs[backend].append([*numbers, *at])
    left_out = [
        line
        for backend in backends
        for line in _leave_out(law, backend, deviations[backend], inputs[backend])
    ]
    return {
        backend: summarized(by_quantity, TYPICAL) for backend, by_quantity in deviations.items()
    }, left_out


def _leave_out(
    law: ControlLaw, backend: str, deviations: Deviations, inputs: Sequence[Sequence[np.ndarray]]
) -> list[str]:
    """Remove the deviations above the limit that are due to the condition of the model at that state, from
    the largest on up to one that is not; return a line for each. `inputs` by group, for each state.
    """
    from ...analysis.exact.extended import due_to_rounding
    from ...model.law import symbols

    groups = [symbols(law.groups[name]) for name in ("params", "config", "gains", "state", "reference")]
    lines = []
    for name, of_name in deviations.items():
        errors, ill = relative(of_name, TYPICAL), []
        for k in np.argsort(errors)[::-1].tolist():
            if errors[k] <= RANDOM_LIMITS[backend].worst or not np.isfinite(errors[k]):
                break
            if not due_to_rounding(
                of_name[k].difference, law.quantities[name], groups, inputs[k], SCALAR[backend]
            ):
                break
            ill.append(k)
            lines.append(f"{backend}: {name} in {of_name[k].where}, error {errors[k]:.1e}")
        deviations[name] = [deviation for k, deviation in enumerate(of_name) if k not in ill]
    return lines


def _add(
    deviations: Deviations, quantities: Iterable[str], evaluation: Evaluation, truth: Evaluation, where: str
) -> None:
    for name in quantities:
        if evaluation.status == truth.status == "ok":
            deviation = deviation_of(evaluation.values[name], truth.values[name], where)
        else:
            deviation = Deviation(
                float("inf"), 0.0, f"{where} (status {evaluation.status}, reference {truth.status})"
            )
        deviations.setdefault(name, []).append(deviation)


def _random_table(tables: dict[str, dict[str, dict[str, ErrorSummary]]], backends: Sequence[str]) -> str:
    titles = {"c": "C double to CasADi", "cf": "C float to double"}
    rows = [["", *(cell for backend in backends for cell in (titles[backend], "median"))]]
    for name, table in tables.items():
        rows.append([name])
        for summaries in table.values():
            worst = max(summaries, key=lambda quantity: summaries[quantity].worst)
            rows[-1] += [
                f"{summaries[worst].worst:.1e} {worst:6}",
                f"{max(s.median for s in summaries.values()):.1e}",
            ]
    rows.append(["limit"])
    for backend in backends:
        limits = RANDOM_LIMITS[backend]
        rows[-1] += [
            f"{limits.worst:.1e} {'':6}",
            f"{limits.median:.1e}" if np.isfinite(limits.median) else "",
        ]
    return "".join(f"  {line.rstrip()}\n" for line in columns(rows))


def deviation_of(value: np.ndarray, expected: np.ndarray, where: str) -> Deviation:
    difference, size = (float(np.abs(of).max(initial=0.0)) for of in (value - expected, expected))
    return Deviation(difference if math.isfinite(difference) else math.inf, size, where)


def deviations_of(values: np.ndarray, expected: np.ndarray) -> list[Deviation]:
    """Return the `deviation_of` each of the values of one quantity, arrays of the same shape, at once."""
    count = len(values)
    differences = np.abs(values - expected).reshape(count, -1).max(axis=1, initial=0.0)
    sizes = np.abs(expected).reshape(count, -1).max(axis=1, initial=0.0)
    finite = np.where(np.isfinite(differences), differences, np.inf)
    return [Deviation(*pair, "") for pair in zip(finite.tolist(), sizes.tolist(), strict=True)]


def relative(deviations: Sequence[Deviation], typical: float) -> list[float]:
    """Return errors relative to the largest entry expected,
    but at least to SMALLEST and `typical` times the median of those."""
    least = max(SMALLEST, typical * float(np.median([deviation.size for deviation in deviations])))
    return [deviation.difference / max(deviation.size, least) for deviation in deviations]


def summarized(deviations: Deviations, typical: float) -> dict[str, ErrorSummary]:
    """Return the errors of each quantity, `relative` to its size."""
    summaries = {}
    for name, of_name in deviations.items():
        errors = relative(of_name, typical)
        worst = int(np.argmax(errors))
        summaries[name] = ErrorSummary(
            errors[worst], float(np.median(errors)), of_name[worst].where, len(of_name)
        )
    return summaries


def _exceeded(title: str, summaries: dict[str, ErrorSummary], limits: ErrorLimits) -> list[str]:
    """Return a line for every quantity that exceeds the limits."""
    return [
        f"{title}: {name} has an error of {s.worst:.1e} in {s.where}; median {s.median:.1e} (limits {limits})"
        for name, s in summaries.items()
        if not s.within(limits)
    ]
