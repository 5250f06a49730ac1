"""Exact analysis of a system: distribution, holonomic part, singular places,
and the control properties of (13)."""

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from ...model.mechanism import Mechanism
from ...model.reduction import ReducedSystem
from ...model.rolling.kinematics import Kinematics
from ...readers.progress import Reported, silent
from ..exact.symbolic import written
from .actuation import Actuation, actuation
from .brackets import Dependence
from .distribution import Distribution, distribution, provable
from .integrals import Holonomic, holonomic
from .places import Places, places
from .properties import SPACE, Check, LinearizationStep, checks, linearization_steps


@dataclass(frozen=True)
class DimensionProof:
    """Proof of the dimensions of the filtration.

    `basis` names the brackets that span Delta*. e_1, e_2, ... (`fields`) span the same, level by level: e_i
    is a multiple of the i-th bracket plus those before it. Lower bound: the minor of the brackets in the
    coordinates `rows` is `minor`, which is not zero. Upper bound: `identities` write every other bracket of
    `generators` g_j, which are multiples of the columns of S, with these fields.
    """

    generators: tuple[sp.Matrix, ...]
    basis: tuple[str, ...]
    fields: tuple[sp.Matrix, ...]
    rows: tuple[str, ...]
    minor: sp.Expr
    identities: tuple[str, ...]

    def text(self) -> list[str]:
        """Return the proof as lines."""
        lines = [
            f"basis {', '.join(self.basis)}",
            f"its minor in ({', '.join(self.rows)}) is {written(self.minor)}",
        ]
        for letter, fields in (("g", self.generators), ("e", self.fields)):
            lines += [
                f"{letter}_{k + 1} = ({', '.join(map(written, field))})" for k, field in enumerate(fields)
            ]
        return lines + list(self.identities)


@dataclass(frozen=True, eq=False)
class Analysis:
    """n coordinates, m constraints, k of them holonomic; all ranks are generic;
    `places` lists where they drop."""

    name: str
    n: int
    m: int
    growth: tuple[int, ...]
    holonomic: Holonomic
    certificate: DimensionProof
    places: Places
    steps: tuple[LinearizationStep, ...]
    checks: tuple[Check, ...]
    S: sp.Matrix
    assumed: tuple[str, ...]  # expressions that are assumed to be positive: roots of squares, absolute values
    actuation: Actuation | None  # None for a system without inputs
    distribution: Distribution

    @property
    def controlled(self) -> str:
        """The system to which the checks apply."""
        if self.actuation is None or self.actuation.full:
            return "q' = S nu, nu' = u"
        inputs = ", ".join(q.name for q in self.actuation.mechanism.inputs)
        return (
            f"the robot as driven by {inputs} alone, {self.actuation.driven} of {self.actuation.dof} "
            "quasi-velocities"
        )

    @property
    def k(self) -> int:
        """Number of holonomic constraints."""
        return self.holonomic.count

    def check(self, name: str, where: str = SPACE) -> Check:
        """Return a check by name. Raises KeyError if there is none of this name."""
        for each in self.checks:
            if (each.name, each.where) == (name, where):
                return each
        raise KeyError((name, where))

    def text(self) -> str:
        """Return the analysis as text."""
        lines = [
            f"{self.name}: {self.n} coordinates, {self.m} constraints: {self.k} holonomic, {self.m - self.k} "
            "nonholonomic",
            f"growth ({', '.join(map(str, self.growth))}), dim Delta* = {self.n - self.k}",
            *_indented("certificate", self.certificate.text()),
            *_indented("integrals", self.holonomic.text()),
            *_indented("where it changes", self.places.text()),
            *_indented(f"properties of {self.controlled}", [check.text() for check in self.checks]),
            *_indented("taken to be positive", self.assumed),
        ]
        return "\n".join(lines)

    def as_json(self) -> dict:
        """Return plain data; `input_state_linearizable` refers to R^(2n-m)."""
        return {
            "name": self.name,
            "coordinates": self.n,
            "constraints": self.m,
            "holonomic": self.k,
            "nonholonomic": self.m - self.k,
            "growth": list(self.growth),
            "integrals": [integral.text() for integral in self.holonomic.integrals],
            "integrals_complete": len(self.holonomic.integrals) == self.k,
            "could_go": [list(names) for names in self.holonomic.could_go],
            "basis": list(self.certificate.basis),
            "singular_places": [
                {
                    "condition": written(place.condition),
                    "words": place.words,
                    "growth": list(place.growth),
                    "constraints_drop": place.constraints_drop,
                    "velocities_fail": place.velocities_fail,
                    "verified": place.verified,
                    "at_defaults": place.at_defaults,
                }
                for place in self.places.places
            ],
            "singular_places_complete": self.places.complete,
            "properties_of": self.controlled,
            "input_state_linearizable": self.check("input_state_linearizable").verdict,
            "checks": [check.as_json() for check in self.checks],
        }


def analyse(system: Kinematics | Mechanism | ReducedSystem, progress: Reported = silent) -> Analysis:
    """Return the exact analysis. Raises ModelError for degenerate systems, for functions that cannot be
    treated exactly, and for what is not decided within WORK.
    """
    Delta = distribution(system)
    functions = Delta.functions
    functions.progress = progress
    mechanism = system.mechanism if isinstance(system, ReducedSystem) else system
    inputs = actuation(mechanism) if isinstance(mechanism, Mechanism) else None
    try:
        with provable(Delta.name):
            return Analysis(
                Delta.name,
                functions.n,
                Delta.m,
                Delta.growth,
                holonomic(Delta),
                certificate(Delta),
                places(Delta),
                linearization_steps(Delta),
                checks(Delta, inputs),
                Delta.S,
                tuple(map(written, functions.positive)),
                inputs,
                Delta,
            )
    finally:
        functions.progress = silent  # the checks keep them, for later questions


def certificate(Delta: Distribution) -> DimensionProof:
    """Return the proof of the growth vector, as text and expressions."""
    functions, basis = Delta.functions, Delta.filtration.basis
    return DimensionProof(
        tuple(sp.Matrix([functions.expression(entry) for entry in field.vector]) for field in Delta.fields),
        tuple(field.name for field in basis),
        tuple(sp.Matrix([functions.expression(entry) for entry in field.vector]) for field in basis),
        tuple(str(functions.coordinates[field.pivot]) for field in basis),
        _minor(Delta),
        tuple(_identity(Delta, dependence) for dependence in Delta.filtration.dependences),
    )


def _minor(Delta: Distribution) -> sp.Expr:
    """Return the minor of the named brackets in the rows of the pivots: the pivots times the divisors."""
    functions, basis = Delta.functions, Delta.filtration.basis
    above = [part for field in basis for part in (field.vector[field.pivot], *field.below)]
    number, powers = functions.product(above, [part for field in basis for part in field.above])
    return sp.Mul(number, *[functions.expression(factor) ** power for factor, power in powers.items()])


def _identity(Delta: Distribution, dependence: Dependence) -> str:
    functions, basis = Delta.functions, Delta.filtration.basis
    left = Delta.fields.index(dependence.left)
    right = next(k for k, field in enumerate(basis) if field is dependence.right)
    divisor = functions.times(dependence.factor, functions.delta)
    quotients = {k: written(functions.quotient(c, divisor)) for k, c in dependence.coefficients.items()}
    return (
        f"[g_{left + 1}, e_{right + 1}] = "
        f"{' + '.join(f'({c})*e_{k + 1}' for k, c in quotients.items()) or '0'}"
    )


def _indented(title: str, lines: Sequence[str]) -> list[str]:
    return [f"{title}:", *[f"  {line}" for line in lines]] if lines else []
