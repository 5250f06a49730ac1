"""Whether q' = S(q) nu is flat, with all coordinates and without the angles on which nothing depends,
and flat outputs of it."""

import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import sympy as sp
from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import Ratio
from ...model.errors import ModelError
from ..distributions.distribution import Distribution, part
from ..distributions.places import joined, words
from ..distributions.properties import LEAF, Check, linearizable_dynamically
from ..exact.functions import Functions, TooLarge
from ..exact.half_angles import expression
from ..exact.points import random_point
from ..exact.readable import readable, unsigned
from ..exact.symbolic import written
from .candidates import DEGREE, pairs
from .chained import FlatPair, flat_pair

WORK = 1_500_000  # most terms that the search for flat outputs of a system takes, some seconds
QUESTION = "flat"
UNKNOWN = "further places are not examined: the functions are too large"


@dataclass(frozen=True)
class FlatOutput:
    """A flat output: an expression in coordinates and parameters, with its unit."""

    expression: sp.Expr
    unit: str

    def row(self, name: str) -> str:
        """Return the row of `Mechanism.output` in a robot's file."""
        return f'("{name}", "{self.unit}", {written(self.expression)})'


@dataclass(frozen=True)
class Found:
    """Flat outputs, as many as quasi-velocities, `singular` where they do not determine the state. With two
    of them that are no inputs of their own, z_1, ..., z_N are a chained form: z_k' = z_(k-1) z_1', k > 2.
    """

    outputs: tuple[FlatOutput, ...]
    singular: tuple[str, ...] = ()
    chained: tuple[sp.Expr, ...] = ()

    @property
    def line(self) -> str:
        """The line of a robot's file with which the outputs become a law."""
        rows = ", ".join(output.row(f"flat_{k + 1}") for k, output in enumerate(self.outputs))
        return f'robot.output("flat", "flat outputs", [{rows}])'


@dataclass(frozen=True)
class Flatness:
    """The verdict about a system `without` some coordinates, and flat outputs `found`;
    else `missing` says why there are none."""

    without: tuple[str, ...]
    check: Check
    found: Found | None = None
    missing: str = ""

    @property
    def system(self) -> str:
        """The system that is judged."""
        of = f"without {', '.join(self.without)}" if self.without else "with all coordinates"
        return f"{of}, on the leaf" if self.check.where == LEAF else of

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        check = self.check
        verdict = {
            "verdict": check.verdict,
            "on": check.where,
            "reason": check.reason,
            "reference": check.reference,
        }
        return {
            "without": list(self.without),
            **verdict,
            **({"not_found": self.missing} if self.missing else {}),
        }

    def outputs_as_json(self) -> dict[str, Any] | None:
        """Return plain data; None without flat outputs."""
        if self.found is None:
            return None
        return {
            "without": list(self.without),
            "outputs": [written(output.expression) for output in self.found.outputs],
            "units": [output.unit for output in self.found.outputs],
            "singular": list(self.found.singular),
            "chained_form": [written(z) for z in self.found.chained],
            "robot_file": self.found.line,
        }


def flatness(Delta: Distribution, velocities: Sequence[str] = ()) -> tuple[Flatness, ...]:
    """Return the verdicts of a system with all its coordinates and, if there are any, without its cyclic
    angles, unless it can move in all directions; `velocities` are the names of the quasi-velocities.

    A verdict or outputs that are not found within WORK are not decided.
    """
    names = tuple(velocities) or tuple(f"nu_{k + 1}" for k in range(len(Delta.fields)))
    with Delta.functions.within(WORK):
        verdicts = [_judged(Delta, names, ())]
    # In fewer directions than it has dimensions
    moves = Delta.functions.n - Delta.holonomic > len(Delta.fields)
    if moves and (angles := cyclic_angles(Delta)):
        rows = [k for k in range(Delta.functions.n) if k not in angles]
        rest = part(Delta, rows, range(len(Delta.fields)))
        with rest.functions.within(WORK):
            verdicts.append(_judged(rest, names, tuple(Delta.coordinates[k].name for k in angles)))
    return tuple(verdicts)


def cyclic_angles(Delta: Distribution) -> tuple[int, ...]:
    """Return the places of angles on which S does not depend, without which its rank stays: those of wheels,
    but not those of joints, whose rates are inputs of their own."""
    rows = list(range(Delta.functions.n))
    for k in _cyclic(Delta):
        if Delta.coordinates[k].unit == "rad" and _rank(Delta, [j for j in rows if j != k]) == len(
            Delta.fields
        ):
            rows.remove(k)
    return tuple(k for k in range(Delta.functions.n) if k not in rows)


def _cyclic(Delta: Distribution) -> list[int]:
    return [k for k, symbol in enumerate(Delta.functions.coordinates) if not Delta.S.has(symbol)]


def _rank(Delta: Distribution, rows: Sequence[int], columns: Sequence[int] | None = None) -> int:
    """Return the rank of some rows and columns of S at a random point."""
    fields = Delta.fields if columns is None else [Delta.fields[k] for k in columns]
    point = random_point(Delta.functions, seed=Delta.functions.n)
    return point.rank([tuple(each.vector[k] for k in rows) for each in fields]) if rows else 0


def _judged(Delta: Distribution, names: Sequence[str], without: tuple[str, ...]) -> Flatness:
    """Return the verdict of a theorem, and flat outputs if they are found; these are a verdict too."""
    try:
        check = replace(linearizable_dynamically(Delta), question=QUESTION)
    except ModelError as error:
        check = Check("flat", QUESTION, "", None, str(error), (), "")
        return Flatness(without, check, missing="the derived flag is not known")
    if check.verdict is False:
        return Flatness(without, check)
    try:
        found = _found(Delta, names)
    except TooLarge:
        return Flatness(without, check, missing=f"not found within {WORK:,} terms of polynomials")
    except ModelError as error:
        return Flatness(without, check, missing=f"not found: {error}")
    if found is None:
        searched = f"with functions of degree {DEGREE} in coordinates, sines and cosines"
        more = (
            ""
            if len(Delta.fields) == 2
            else ", for two inputs beside those of coordinates on which nothing depends"
        )
        return Flatness(without, check, missing=f"none found {searched}{more}")
    if check.verdict is None:
        reason = f"{len(found.outputs)} flat outputs were found"
        check = replace(
            check, verdict=True, reason=reason, reference="their chained form is verified exactly"
        )
    return Flatness(without, check, found)


def _found(Delta: Distribution, names: Sequence[str]) -> Found | None:
    """Return flat outputs. As many quasi-velocities as dimensions: coordinates. A coordinate on which nothing
    depends, and whose rate is an input of its own, is one, the others are those of the rest. Else pairs of
    functions are tried. Raises TooLarge.
    """
    functions, inputs = Delta.functions, len(Delta.fields)
    everything = list(range(functions.n))
    if functions.n - Delta.holonomic == inputs:
        chosen: list[int] = []
        for k in everything:
            if _rank(Delta, [*chosen, k]) > len(chosen):
                chosen.append(k)
        return Found(tuple(FlatOutput(functions.coordinates[k], Delta.coordinates[k].unit) for k in chosen))
    for k in _cyclic(Delta) if inputs > 2 else ():
        rows = [j for j in everything if j != k]
        if _rank(Delta, rows) < inputs:
            columns = next(
                c
                for c in itertools.combinations(range(inputs), inputs - 1)
                if _rank(Delta, rows, c) == inputs - 1
            )
            rest = part(Delta, rows, columns)
            with rest.functions.within(WORK):
                found = _found(rest, [names[c] for c in columns])
            own = FlatOutput(functions.coordinates[k], Delta.coordinates[k].unit)
            return replace(found, outputs=(*found.outputs, own)) if found else None
    if inputs != 2:
        return None
    if all(angle.expression.is_Symbol for angle in functions.angles):
        return _best_pair(Delta, names)
    # Points have sines and cosines of single angles
    alike = part(Delta, everything, range(inputs), expanded=True)
    with alike.functions.within(WORK):
        return _best_pair(alike, names)


def _best_pair(Delta: Distribution, names: Sequence[str]) -> Found | None:
    """Return the first pair of flat outputs that is singular only where both are at rest for a velocity zero,
    or else that with the fewest conditions. Raises TooLarge if none is found before."""
    best: Found | None = None
    try:
        for first, last in pairs(Delta):
            pair = flat_pair(Delta, first, last)
            found = _of_pair(Delta, names, pair) if pair else None
            if found and (best is None or len(found.singular) < len(best.singular)):
                best = found
            if best and len(best.singular) == 1:
                break
    except TooLarge:
        if best is None:
            raise
    return best


def _of_pair(Delta: Distribution, names: Sequence[str], pair: FlatPair) -> Found:
    functions = Delta.functions
    conditions = [f"{written(_at_rest(Delta, names, pair.speed))} = 0", *_in_words(functions, pair.resting)]
    if pair.direction:
        conditions.append(
            " and ".join(f"{written(expression(functions, each))} = 0" for each in pair.direction)
        )
    if pair.singular is None:
        conditions.append(UNKNOWN)
    else:
        conditions += [
            each if pair.exact else f"{each}, perhaps" for each in _in_words(functions, pair.singular)
        ]
    outputs = tuple(
        FlatOutput(_readable(functions, each), _unit(Delta, each)) for each in (pair.first, pair.last)
    )
    return Found(outputs, tuple(conditions), tuple(_readable(functions, each) for each in pair.chained))


def _at_rest(Delta: Distribution, names: Sequence[str], speed: Sequence[Ratio]) -> sp.Expr:
    """Return s' nu, without factors in q, from s along the fields,
    which are multiples of the columns of S."""
    functions = Delta.functions
    entries = []
    for (up, down), column in zip(speed, Delta.fields, strict=True):
        above = functools.reduce(functions.times, column.above, down)
        below = functools.reduce(functions.times, column.below, up)
        entries.append(functions.quotient(below, above))
    rates = [sp.Symbol(name) for name in names]
    total = sp.factor(
        sp.together(sp.Add(*[entry * rate for entry, rate in zip(entries, rates, strict=True)]))
    )
    return unsigned(sp.Mul(*[each for each in sp.Mul.make_args(total) if each.has(*rates)]))


def _in_words(functions: Functions, forms: Iterable[PolyElement]) -> list[str]:
    """Return conditions for components, such as angles; pairs of them with a shorter condition are one."""
    return [words(functions, form) for form in joined(functions, dict.fromkeys(forms))]


def _readable(functions: Functions, ratio: Ratio) -> sp.Expr:
    return (
        readable(sp.expand(functions.quotient(*ratio)))
        if ratio[1].is_ground
        else readable(functions.quotient(*ratio))
    )


def _unit(Delta: Distribution, ratio: Ratio) -> str:
    """Return the unit of an output, that of its first term; units of angles count as none in products."""
    functions = Delta.functions
    units = dict(_units(Delta))
    powers: dict[str, int] = {}
    for sign, polynomial in zip((1, -1), ratio, strict=True):
        for place, power in enumerate(polynomial.leading_expv()):
            unit = units.get(functions.expressions[place], "1")
            if power and unit not in ("1", "rad"):
                powers[unit] = powers.get(unit, 0) + sign * power
    parts = [unit if power == 1 else f"{unit}^{power}" for unit, power in powers.items() if power]
    return " ".join(parts) or "rad"


def _units(Delta: Distribution) -> Iterator[tuple[sp.Expr, str]]:
    functions = Delta.functions
    quantities = (*Delta.parameters, *Delta.coordinates)
    return zip(functions.symbols, (quantity.unit for quantity in quantities), strict=True)
