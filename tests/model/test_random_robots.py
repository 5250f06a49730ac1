"""The C of random robots against projected Newton-Euler in 40 digits: see random_robots.py.

`python -m noslip.tests.model.test_random_robots FIRST COUNT` prints the table of those robots, and what is
off.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import islice

import numpy as np
import pytest
from noslip.codegen.dynamics import ENTRIES
from noslip.codegen.files import robot_files
from noslip.model import ModelError, control_law, reduce
from noslip.model.outputs import output_map
from noslip.simulation.controllers.compiled import (
    CompiledController,
    CompiledDynamics,
    DynamicsLibrary,
    Library,
)
from noslip.tests.random_robots import drawn, mechanism, states, truth

# Of a quantity's largest entry, or of a tenth of its median size over the states
LIMIT = {"double": 1e-10, "float": 2e-4}
STATES = 6
HEAVY = 1e3  # the largest condition number of S'MS at a state that is compared, scaled to a diagonal of ones
NIGHTLY, PIECE = range(100), 20  # robots of the night, and of each of its tests
FEW = 1  # in the normal suite: the first with up to two quasi-velocities, which is quick to generate
OF_LAW = ("h", "ydot", "Phi", "Phidot", "u", "tau")


@dataclass(frozen=True)
class Outcome:
    """Of one robot: why it is refused, or the largest error by scalar and what has it."""

    seed: int
    refused: str = ""
    worst: tuple[tuple[str, float, str], ...] = ()  # scalar, error, what

    def wrong(self) -> list[str]:
        """What is beyond its limit."""
        return [
            f"robot {self.seed}, {scalar}: {name} off by {e:.1e}"
            for scalar, e, name in self.worst
            if not e <= LIMIT[scalar]
        ]


@cache
def outcome(seed: int) -> Outcome:
    """Generates and compiles a robot's law and dynamics and compares every quantity at some states."""
    robot = drawn(seed)
    try:
        system = reduce(mechanism(robot))
        law = control_law(system, output_map(system, "own"))
        files = robot_files(system, [law])
        libraries = {
            scalar: (Library(law, scalar, files), DynamicsLibrary(system, scalar, files)) for scalar in LIMIT
        }
    except ModelError as error:
        return Outcome(seed, str(error))
    assert law.linearization.relative_degree == tuple(degree for degree, _ in robot.outputs)
    names = [q.name for q in system.quasi_velocities]
    possible = ((state, truth(robot, state, names)) for state in states(robot, 4 * STATES))
    inputs, right = zip(
        *islice(((state, exact) for state, exact in possible if _is_heavy(exact["Mbar"])), STATES),
        strict=True,
    )
    worst = []
    for scalar, (law_library, dynamics_library) in libraries.items():
        errors: dict[str, list[tuple[float, float, str]]] = {}
        for k, (state, exact) in enumerate(zip(inputs, right, strict=True)):
            answers = _answers(law, law_library, dynamics_library, state)
            for name, values in exact.items():
                for entry, got in answers[name].items():
                    off = np.abs(got.ravel() - values.ravel()).max(initial=0.0) if got is not None else np.inf
                    where = f"{name} by {entry} at state {k}"
                    errors.setdefault(name, []).append((off, np.abs(values).max(initial=0.0), where))
        relative = []
        for rows in errors.values():
            typical = np.median([size for _, size, _ in rows])
            relative += [(_finite(off / max(size, 0.1 * typical, 1e-3)), where) for off, size, where in rows]
        worst.append((scalar, *max(relative)))
    return Outcome(seed, worst=tuple(worst))


def _answers(law, law_library, dynamics_library, state) -> dict[str, dict[str, np.ndarray | None]]:
    """By quantity and entry point; None where the status is not ok."""
    x = np.array([*state.q, *state.nu])
    controller = CompiledController(law, state.p, (), state.gains, made_by=law_library)
    dynamics = CompiledDynamics(dynamics_library, state.p)
    evaluation, (status, tau) = controller.evaluate(x, state.reference), controller.step(x, state.reference)
    answers = {name: {"evaluate": evaluation.values.get(name)} for name in OF_LAW}
    answers["tau"]["step"] = tau if status == "ok" else None
    for entry in ENTRIES:
        answer = dynamics.entry(entry, x, state.tau).values
        for name in entry.answers:
            answers.setdefault(name, {})[f"dynamics_{entry.name}"] = answer.get(name)
    return answers


def _is_heavy(mass: np.ndarray) -> bool:
    """Is S'MS, scaled to a diagonal of ones, well conditioned? Float's 6e-8 times the bound is well below its
    LIMIT.

    Which quasi-velocities a robot has may be the reduction's choice, and the condition depends on it.
    """
    scale = np.sqrt(np.diag(mass))
    return bool(np.linalg.cond(mass / np.outer(scale, scale)) < HEAVY)


def _finite(error: float) -> float:
    return float(error) if np.isfinite(error) else float("inf")


def table(outcomes: list[Outcome]) -> str:
    """Robots, refused by reason, worst errors."""
    refused = Counter(re.sub(r"'[^']*'|\b\w*\d\w*\b", "..", o.refused) for o in outcomes if o.refused)
    compared = [o for o in outcomes if not o.refused]
    lines = [f"robots {len(outcomes)}, compared {len(compared)}, refused {sum(refused.values())}"]
    lines += [f"  {count} refused: {reason}" for reason, count in refused.most_common()]
    for k, scalar in enumerate(LIMIT):
        errors = [o.worst[k][1] for o in compared]
        beyond = sum(not e <= LIMIT[scalar] for e in errors)
        good = [e for e in errors if e <= LIMIT[scalar]]
        lines.append(
            f"  {scalar}: worst {max(errors, default=0):.1e}, beyond {LIMIT[scalar]:g}: {beyond}; "
            f"worst of the others {max(good, default=0):.1e}, median {np.median(errors):.1e}"
        )
    return "\n".join(lines)


def check(seeds: Iterable[int]) -> None:
    outcomes = [outcome(seed) for seed in seeds]
    print(table(outcomes))
    assert not [line for o in outcomes for line in o.wrong()]
    assert all(o.refused.count("\n") == 0 for o in outcomes)
    assert sum(bool(o.refused) for o in outcomes) <= len(outcomes) / 5


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """What is compiled here is not wanted again."""
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path))


def test_some_random_robots():
    check(islice((seed for seed in NIGHTLY if drawn(seed).dof <= 2), FEW))


@pytest.mark.nightly
@pytest.mark.parametrize("first", range(0, len(NIGHTLY), PIECE))
def test_many_random_robots(first):
    check(NIGHTLY[first : first + PIECE])


if __name__ == "__main__":
    first, count = map(int, sys.argv[1:])
    outcomes = []
    for seed in range(first, first + count):
        outcomes.append(outcome(seed))
        for line in outcomes[-1].wrong() or (
            [f"robot {seed} refused: {outcomes[-1].refused}"] if outcomes[-1].refused else []
        ):
            print(line, flush=True)
        if len(outcomes) % 25 == 0 or len(outcomes) == count:
            print(table(outcomes), flush=True)
