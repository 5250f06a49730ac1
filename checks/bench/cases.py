"""The seeded states for all programs, and the expected results, as C."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from noslip.codegen.printing.scalar import SCALARS
from noslip.model.law import ControlLaw

COUNT = 256
SEED = 1992
REGULAR = 0.1  # smallest |det Phi| over the product of its row norms, so that no program leaves at a guard
QUANTITIES = ("tau", "Phi", "Phidot")
# Relative to 1 + |expected|: rejects a wrong program; rounding is tested elsewhere
TOLERANCE = {"double": 1e-9, "float": 3e-3}


@dataclass
class Cases:
    """Inputs of a law, a row for each state, and the expected quantities, row-major."""

    law: ControlLaw
    fixed: dict[str, np.ndarray]
    state: np.ndarray
    reference: np.ndarray
    expected: dict[str, np.ndarray] = field(default_factory=dict)


def make_cases(law: ControlLaw) -> Cases:
    """COUNT states within 5 m and pi rad, wheel rates within 10 rad/s, references within 2,
    none near the singular set."""
    fixed = {
        "params": np.array([q.default for q in law.parameters]),
        "config": np.array([0.2 if q.name == "L" else q.default for q in law.config]),
        "gains": np.array([q.default * (1 + 0.1 * k) for k, q in enumerate(law.gains)]),
    }
    found = law.linearization
    sine = found.determinant / ca.sqrt(found.scale_squared)
    function = law.function({"tau": law.tau, "Phi": found.Phi.T, "Phidot": found.Phidot.T, "sine": sine})
    states, references, rows = [], [], []
    for state, reference in _random(law):
        *row, size = (
            np.array(value).ravel(order="F") for value in function(*fixed.values(), state, reference)
        )
        if abs(size) > REGULAR and np.abs(row[0]).max() < 1e3:
            states.append(state)
            references.append(reference)
            rows.append(row)
        if len(states) == COUNT:
            break
    expected = {
        name: np.array(values) for name, values in zip(QUANTITIES, zip(*rows, strict=True), strict=True)
    }
    return Cases(law, fixed, np.array(states), np.array(references), expected)


def _random(law: ControlLaw) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    width = {"m": 5.0, "rad": np.pi, "rad/s": 10.0}
    span = np.array([width[q.unit] for q in law.state])
    source = np.random.default_rng(SEED)
    while True:
        yield source.uniform(-span, span), source.uniform(-2.0, 2.0, len(law.reference))


def header(cases: list[Cases], scalar: str) -> str:
    """Return declarations of all arrays."""
    arrays = [f"extern const {scalar} {name}{shape};" for case in cases for name, shape, _ in _arrays(case)]
    return "\n".join(["#pragma once", *arrays, ""])


def source(case: Cases, scalar: str) -> str:
    """Return the arrays of a law."""
    literal = SCALARS[scalar].literal
    lines = [f'#include "cases_{scalar}.h"']
    for name, shape, values in _arrays(case):
        rows = ",\n".join("{" + ", ".join(map(literal, row)) + "}" for row in np.atleast_2d(values))
        lines.append(f"const {scalar} {name}{shape} = {'{' + rows + '}' if values.ndim == 2 else rows};")
    return "\n".join(lines) + "\n"


def _arrays(case: Cases) -> list[tuple[str, str, np.ndarray]]:
    law = case.law.name
    named = {**case.fixed, "state": case.state, "reference": case.reference, **case.expected}
    return [
        (f"{law}_{key}", "".join(f"[{n}]" for n in values.shape), values) for key, values in named.items()
    ]
