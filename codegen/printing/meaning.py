"""Comments for the constants and temporaries of generated C: formulas in the names of the model,
and units."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import gcd, lcm

import numpy as np

from ...model.linearization import SINGULAR, SINGULAR_SQUARED
from ..dynamics import DynamicsProgram
from ..evaluation import evaluate
from ..graph import Applied, Constant, Leaf, MatrixInverse, Node, Operation, reachable
from ..program import MARGIN, Program
from .layout import WIDTH, aside

LONGEST = 80  # characters of a formula; for a longer one the names in it are listed
STATES = 4  # random states at which nodes are compared with steps of the derivation
SAME = 1e-9  # relative difference up to which two numbers count as equal
PURE = (SINGULAR, SINGULAR_SQUARED)  # thresholds, without a unit
DERIVED = {"kg m^2/s^2": "N m", "kg m/s^2": "N"}

Unit = dict[str, Fraction]  # base unit -> exponent


@dataclass(frozen=True)
class Monomial:
    """coefficient * the product of factor^exponent; a factor is the text of a name, a function or a sum."""

    coefficient: Fraction
    powers: tuple[tuple[str, int], ...] = ()

    def __mul__(self, other: "Monomial") -> "Monomial":
        powers = dict(self.powers)
        for factor, exponent in other.powers:
            powers[factor] = powers.get(factor, 0) + exponent
        return Monomial(
            self.coefficient * other.coefficient, tuple(sorted((f, e) for f, e in powers.items() if e))
        )

    def inverse(self) -> "Monomial":
        """Return 1 / the product, which is not zero."""
        return Monomial(1 / self.coefficient, tuple((factor, -exponent) for factor, exponent in self.powers))

    def __str__(self) -> str:
        if self.coefficient == 1 and len(self.powers) == 1 and self.powers[0][1] == 1:
            return self.powers[0][0]
        above = [_power(factor, e) for factor, e in self._ordered() if e > 0]
        below = [_power(factor, -e) for factor, e in self._ordered() if e < 0]
        number = abs(self.coefficient)
        if max(number.numerator, number.denominator) < 10000:
            above = [str(number.numerator)] * (number.numerator != 1 or not above) + above
            below = [str(number.denominator)] * (number.denominator != 1) + below
        else:
            above.insert(0, repr(float(number)))
        text = " ".join(above)
        if below:
            text += "/" + (below[0] if len(below) == 1 else f"({' '.join(below)})")
        return ("-" if self.coefficient < 0 else "") + text

    def _ordered(self) -> list[tuple[str, int]]:
        return sorted(
            self.powers,
            key=lambda power: (_is_sum(power[0]), power[0].startswith(("sin(", "cos(")), power[0]),
        )


class Meanings:
    """Comments for the nodes of one program: constants, and values of a step in the names of the derivation's
    steps."""

    def __init__(self, program: Program | DynamicsProgram):
        self._units = {(group, q.name): q.unit for group, members in program.groups.items() for q in members}
        self._labels = program.labels
        self._stands = {
            step.leaf: step.node for body in program.entries.values() for step in getattr(body, "steps", ())
        }
        steps = [part for leaf, node in self._stands.items() for part in (*reachable([node]), leaf)]
        roots = [root for body in program.entries.values() for root in body.roots]
        self._nodes = list(dict.fromkeys([*steps, *reachable([*roots, *program.constants, *self._labels])]))
        self._products: dict[Node, Monomial | None] = {}
        self._sums: dict[str, list[Monomial]] = {}  # the terms of a sum, by its text
        self._known_units: dict[Node, Unit | None] = {}

    def constant(self, node: Node) -> str:
        """Return `unit: formula` of a function of the parameters; for a parameter itself the unit only."""
        unit = unit_text(self.unit(node))
        if isinstance(node, Leaf):
            return self._units[node.group, node.name]
        return f"{unit}: {self.formula(node)}" if unit else self.formula(node)

    def formula(self, node: Node) -> str:
        """Return the formula of a function of the parameters;
        the list of names in it if that would be long."""
        product = self.product(node)
        text = str(product) if product is not None else ""
        if text and len(text) <= LONGEST:
            return text
        names = "of " + ", ".join(sorted({leaf.name for leaf in reachable([node]) if isinstance(leaf, Leaf)}))
        return names + (
            "; positive if Phi is regular at all angles" if self._labels.get(node) == MARGIN else ""
        )

    def legend(self, constants: Mapping[Node, str], lines: Sequence[str]) -> list[str]:
        """Return a comment for each numbered constant that these statements read."""
        read = set(re.findall(r"self->(\w+)", " ".join(lines)))
        formulas = []
        for node, field in constants.items():
            if field in read and node.arguments:
                unit, formula = unit_text(self.unit(node)), self.formula(node)
                formulas.append(
                    f"{field}{f' ({unit})' if unit else ''} "
                    f"{formula if formula.startswith('of ') else f'= {formula}'}"
                )
        return ["\n".join(line for text in formulas for line in aside(text, WIDTH - 4))] if formulas else []

    def temporary(self, node: Node, users: Sequence[str]) -> str:
        """Return the meaning of a value of a step: its formula if short, else the names of its users."""
        product = self.product(node)
        text = str(product) if product is not None else ""
        if text and len(text) <= LONGEST:
            return text
        return f"part of {', '.join([*users[:4], *(['...'] if len(users) > 4 else [])])}"

    # -- formulas --------------------------------------------------------------------------------------------

    def product(self, node: Node) -> Monomial | None:
        """Return the formula of a node; None if it is too long. Arguments are looked at only where the node
        is not a step."""
        below: dict[Node, list[Node]] = {}  # of nodes that are not steps: what their formulas are made of
        stack = [node]
        while stack:
            part = stack.pop()
            if part in self._products:
                continue
            if part in below:
                self._products[part] = self._made(part)
            elif known := self._known(part):
                self._products[part] = known
            else:
                below[part] = [self._stands[part]] if part in self._stands else list(part.arguments)
                stack += [part, *reversed(below[part])]
        return self._products[node]

    def _known(self, node: Node) -> Monomial | None:
        """Return the node as a step of the derivation, or a multiple of one by a function of the parameters,
        if it is."""
        if not node.arguments or node.fixed:
            return None
        if node in self._labels:
            return Monomial(Fraction(1), ((self._labels[node], 1),))
        names, steps = self._steps
        values = self._values.get(node)
        if values is None or values.ndim != 1 or not _usable(values) or not names:  # a matrix is not a step
            return None
        ratios = values / steps
        for k in np.flatnonzero(
            np.all(np.abs(ratios - ratios[:, :1]) <= SAME * np.abs(ratios[:, :1]), axis=1)
        ):
            factor = self._factor(ratios[k, 0])
            if factor is not None:
                return factor * Monomial(Fraction(1), ((names[k], 1),))
        return None

    def _factor(self, ratio: float) -> Monomial | None:
        """Return the formula of a function of the parameters with this value or its negative;
        None if the program has none."""
        numbers, nodes = self._fixed_values
        for inverted, candidates in ((False, numbers), (True, 1 / numbers)):
            for k in np.flatnonzero(np.abs(np.abs(candidates) - abs(ratio)) <= SAME * abs(ratio)):
                product = self.product(nodes[k])
                if product is None or not product.coefficient:
                    continue
                product = product.inverse() if inverted else product
                if len(str(product)) <= LONGEST // 2:
                    return Monomial(Fraction(1 if candidates[k] * ratio > 0 else -1)) * product
        return None

    def _made(self, node: Node) -> Monomial | None:
        """Return the formula of a node from its arguments."""
        match node:
            case Leaf():
                return (
                    self._products[self._stands[node]]
                    if node in self._stands
                    else Monomial(Fraction(1), ((node.name, 1),))
                )
            case Constant(value):
                return Monomial(Fraction(repr(value)))
        products = [
            product for argument in node.arguments if (product := self._products[argument]) is not None
        ]
        if not isinstance(node, Applied) or len(products) < len(node.arguments):
            return None
        match node.operation, products:
            case Operation.NEG, [one]:
                return Monomial(Fraction(-1)) * one
            case Operation.MUL, [one, other]:
                return one * other
            case Operation.DIV, [one, other]:
                return one * other.inverse() if other.coefficient else None
            case ((Operation.ADD | Operation.SUB), [one, other]):
                sign = Monomial(Fraction(1 if node.operation is Operation.ADD else -1))
                return self._sum([*self._terms(one), *(sign * term for term in self._terms(other))])
        text = f"{node.operation}({', '.join(map(str, products))})"
        return Monomial(Fraction(1), ((text, 1),)) if len(text) <= LONGEST else None

    def _terms(self, product: Monomial) -> list[Monomial]:
        """Return the terms of a sum times other factors, else the product itself."""
        inner = [factor for factor, exponent in product.powers if exponent == 1 and factor in self._sums]
        if len(inner) != 1 or sum(_is_sum(factor) for factor, _ in product.powers) > 1:
            return [product]
        others = Monomial(
            product.coefficient, tuple(power for power in product.powers if power[0] != inner[0])
        )
        return [others * term for term in self._sums[inner[0]]]

    def _sum(self, terms: Sequence[Monomial]) -> Monomial | None:
        """Return a sum with its common factor outside."""
        merged: dict[tuple[tuple[str, int], ...], Fraction] = {}
        for term in terms:
            merged[term.powers] = merged.get(term.powers, Fraction(0)) + term.coefficient
        kept = [Monomial(coefficient, powers) for powers, coefficient in merged.items() if coefficient]
        if len(kept) <= 1:
            return kept[0] if kept else Monomial(Fraction(0))
        factors = sorted({factor for term in kept for factor, _ in term.powers})
        least = {f: min(dict(term.powers).get(f, 0) for term in kept) for f in factors}
        numbers = [term.coefficient for term in kept]
        size = Fraction(gcd(*(n.numerator for n in numbers)), lcm(*(n.denominator for n in numbers)))
        size = -size if all(n < 0 for n in numbers) else size
        common = Monomial(size, tuple(sorted((f, e) for f, e in least.items() if e)))
        rest = [term * common.inverse() for term in kept]
        rest.sort(key=lambda term: (term.coefficient < 0, str(Monomial(Fraction(1), term.powers))))
        text = str(rest[0]) + "".join(
            f" {'-' if t.coefficient < 0 else '+'} {str(t).removeprefix('-')}" for t in rest[1:]
        )
        if len(text) > 2 * LONGEST:
            return None
        self._sums[text] = rest
        return common * Monomial(Fraction(1), ((text, 1),))

    # -- numbers at random states ----------------------------------------------------------------------------

    @cached_property
    def _values(self) -> dict[Node, np.ndarray]:
        return evaluate(self._nodes, STATES, self._stands)

    @cached_property
    def _steps(self) -> tuple[list[str], np.ndarray]:
        """Return the names of the steps of the derivation, and their values by rows."""
        steps = [(name, self._values[node]) for node, name in self._labels.items() if not node.fixed]
        steps = [(name, values) for name, values in steps if _usable(values)]
        return [name for name, _ in steps], np.array([values for _, values in steps])

    @cached_property
    def _fixed_values(self) -> tuple[np.ndarray, list[Node]]:
        """Return the values of functions of the parameters, in order of creation."""
        nodes = [node for node in self._nodes if node.fixed and not isinstance(node, MatrixInverse)]
        nodes = [node for node in nodes if _usable(self._values[node])]
        return np.array([self._values[node][0] for node in nodes]), nodes

    # -- units -----------------------------------------------------------------------------------------------

    def unit(self, node: Node) -> Unit | None:
        """Return the unit of a node; None if it does not follow from those of the leaves."""
        for part in reachable([node]) if node not in self._known_units else ():
            if part not in self._known_units:
                self._known_units[part] = self._unit_of(part)
        return self._known_units[node]

    def _unit_of(self, node: Node) -> Unit | None:
        match node:
            case Leaf():
                return unit_of(self._units.get((node.group, node.name), "?"))
            case Constant(value):  # other numbers may have a unit
                return {} if value in PURE or Fraction(repr(value)).denominator in (1, 2, 4, 8, 16) else None
        units = [unit for argument in node.arguments if (unit := self._known_units[argument]) is not None]
        if not isinstance(node, Applied) or len(units) < len(node.arguments):
            return None
        match node.operation, units:
            case ((Operation.NEG | Operation.ABS), [one]):
                return one
            case Operation.MUL, [one, other]:
                return _combined(one, other, 1)
            case Operation.DIV, [one, other]:
                return _combined(one, other, -1)
            case Operation.SQRT, [one]:
                return {base: exponent / 2 for base, exponent in one.items()}
            case ((Operation.ADD | Operation.SUB), [one, other]):
                return one if one == other else None
        return None if any(units) else {}


@lru_cache(maxsize=64)
def meanings(program: Program | DynamicsProgram) -> Meanings:
    """Return the comments of a program, equal for both scalars, computed once per process."""
    return Meanings(program)


def users(roots: Sequence[tuple[Node, str]], named: Mapping[Node, str]) -> Callable[[Node], list[str]]:
    """Return a function from a node to the names of its nearest named users: nodes,
    and places to which roots are written."""
    above: dict[Node, list[Node]] = {}
    for node in reachable(root for root, _ in roots):
        for argument in node.arguments:
            above.setdefault(argument, []).append(node)
    places: dict[Node, list[str]] = {}
    for root, place in roots:
        places.setdefault(root, []).append(place)

    def of(node: Node) -> list[str]:
        names: dict[str, None] = dict.fromkeys(places.get(node, ()))
        visited, stack = {node}, list(above.get(node, ()))
        for user in stack:  # which grows
            if user in visited:
                continue
            visited.add(user)
            names.update(dict.fromkeys([named[user]] if user in named else places.get(user, ())))
            if user not in named:
                stack += above.get(user, ())
        return list(names)

    return of


def unit_of(text: str) -> Unit | None:
    """Return a unit as exponents of kg, m, s and other names;
    None if the text is not understood. Angles have no unit."""
    if "sqrt" in text:
        return None
    unit: Unit = {}
    above, slash, below = text.replace("(", " ").replace(")", " ").partition("/")
    for part, sign in ((above, 1), (below, -1)):
        for token in part.split():
            match = re.fullmatch(r"([A-Za-z]+)(?:\^(-?\d+))?", token)
            if match is None:
                if token == "1":
                    continue
                return None
            base, exponent = match[1], sign * int(match[2] or 1)
            for one, times in {"N": (("kg", 1), ("m", 1), ("s", -2)), "rad": ()}.get(base, ((base, 1),)):
                unit = _combined(unit, {one: Fraction(times * exponent)}, 1)
    return unit


def unit_text(unit: Unit | None) -> str:
    """Return the unit as text, empty without a unit."""
    if not unit or any(exponent.denominator != 1 for exponent in unit.values()):
        return ""
    ordered = sorted(unit.items())  # kg, m, s
    above = " ".join(_power(base, int(e)) for base, e in ordered if e > 0) or "1"
    below = [_power(base, int(-e)) for base, e in ordered if e < 0]
    text = above + ("/" + (below[0] if len(below) == 1 else f"({' '.join(below)})") if below else "")
    return DERIVED.get(text, text)


def _combined(one: Unit, other: Unit, sign: int) -> Unit:
    return {
        base: e
        for base in {**one, **other}
        if (e := one.get(base, Fraction(0)) + sign * other.get(base, Fraction(0)))
    }


def _usable(values: np.ndarray) -> bool:
    return bool(np.all(np.isfinite(values)) and np.all(values != 0))


@lru_cache(maxsize=65536)
def _power(factor: str, exponent: int) -> str:
    text = f"({factor})" if _is_sum(factor) else factor
    return text if exponent == 1 else f"{text}^{exponent}"


@lru_cache(maxsize=65536)
def _is_sum(factor: str) -> bool:
    """Whether the text has a + or - outside parentheses."""
    return re.search(r" [+-] ", re.sub(r"\([^()]*\)", "", re.sub(r"\([^()]*\)", "", factor))) is not None
