"""Where ranks drop: places at which constraints depend on each other, S fails, or the growth vector is another."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy import QQ
from sympy.polys.rings import PolyElement

from .brackets import Brackets, Span, VectorField
from .distribution import Distribution
from .errors import ModelError
from .functions import Functions, TooLarge, Vector
from .points import MODULAR, NoPoint, Point, random_point
from .ratios import generators_of
from .symbolic import written

SEEDS = 3  # points looked at on each place
MORE_STEPS = 3  # of brackets than generically needed, on a place
AVOIDING = 4  # tries to keep off other places
MINORS = 8  # looked at to show that there is no other place
TERMS = 40  # of all of them together


@dataclass(frozen=True)
class Place:
    """The set where `condition` is zero, and what is different at its generic points.

    `growth` are the dimensions there, as far as they were followed. `exact`: they were found at points with rational
    coordinates or sines and cosines; else modulo a prime, where a rank that is too low by chance is very unlikely.
    """

    condition: sp.Expr
    words: str
    growth: tuple[int, ...]
    whole: bool  # it reaches dim Delta*; else it may do so later
    constraints_drop: bool  # the rows of A depend on each other there
    velocities_fail: bool  # S has a pole or dependent columns there, though A is regular
    exact: bool

    def undecided(self, generic: tuple[int, ...]) -> bool:
        """Nothing differs from the generic, but the growth was not followed to its end."""
        return not self.constraints_drop and not self.velocities_fail and self.growth == generic[: len(self.growth)]

    def text(self) -> str:
        """One line."""
        about = []
        if self.constraints_drop:
            about.append("the constraints depend on each other")
        if self.velocities_fail:
            about.append("the quasi-velocities fail (a pole of S, or dependent columns): choose others there")
        if self.growth:
            about.append(f"growth ({', '.join(map(str, self.growth))}{'' if self.whole else ', ...'})")
        return f"{self.words}: {'; '.join(about)}"


@dataclass(frozen=True)
class Places:
    """All places of codimension one; smaller ones are not excluded where all minors of an entry of `doubts` vanish together."""

    places: tuple[Place, ...]
    doubts: tuple[tuple[str, ...], ...]

    @property
    def complete(self) -> bool:
        """Is it proved that nothing changes anywhere else?"""
        return not self.doubts

    def text(self) -> list[str]:
        """Lines."""
        lines = [place.text() for place in self.places]
        if lines:
            lines.append("these are dimensions at generic points of each; on smaller sets within, they may be lower still")
        lines += [f"smaller sets are not excluded where these vanish together: {', '.join(minors)}" for minors in self.doubts]
        return lines or ["nowhere, proved"]


def places(found: Distribution) -> Places:
    """Where the rank of A, of S, or a dimension in the filtration drops.

    A drop on a hypersurface makes every minor vanish there, so its equation is a factor of the one minor looked at: the
    product of the pivots. Each factor is then judged at exact points of its zeros, with the brackets themselves.
    """
    functions = found.functions
    candidates = dict.fromkeys(_vanishing_factors(functions, [part for column in found.fields for part in column.above]))
    levels = range(0 if found.forms else 1, len(found.growth) + 1)
    for level in levels:
        candidates.update(dict.fromkeys(_minor_factors(functions, _level(found, level))))
    candidates.update(dict.fromkeys(_hidden(functions, list(candidates))))
    kept: dict[PolyElement, Place] = {}
    doubts: list[tuple[str, ...]] = []
    brackets: dict[tuple[Vector, ...], Brackets] = {}
    for factor in sorted(candidates, key=len):
        place = _judge(found, factor, list(kept), brackets)
        if place is not None and place.undecided(found.growth):
            doubts.append((written(place.condition),))
        elif place is not None:
            kept[factor] = place
    doubts += [_doubt(found, level, list(kept)) for level in levels]
    return Places(tuple(kept.values()), tuple(dict.fromkeys(doubt for doubt in doubts if doubt)))


def _level(found: Distribution, level: int, point: Point | None = None) -> list[VectorField]:
    """Echelon form of a basis of Delta_level, level 0 being the rows of A; pivots that do not vanish at `point` preferred.

    Raises TooLarge, or ModelError for the same reason.
    """
    span = Span(found.functions, point=point)
    if level == 0:
        fields: Sequence[VectorField] = found.forms
    else:
        near = found if point is None else found.near(point)
        fields = near.filtration.basis[: found.growth[level - 1]]
    for each in fields:
        span.add(each)
    return span.fields


def words(functions: Functions, factor: PolyElement) -> str:
    """The condition factor = 0 in words."""
    for angle in functions.angles:
        if angle.sine is None:
            continue
        cosine, sine = functions.ring.gens[angle.cosine], functions.ring.gens[angle.sine]
        known = {cosine: "an odd multiple of 90 degrees", sine: "a multiple of 180 degrees"}
        known |= {cosine - 1: "a multiple of 360 degrees", cosine + 1: "an odd multiple of 180 degrees"}
        for shape, about in known.items():
            if factor in (shape, -shape):
                return f"{angle.expression} is {about}"
    expression = functions.expression(factor)
    turned = sp.fu(expression) if len(factor) <= 8 and expression.has(sp.sin) else expression
    for kind, about in ((sp.cos, "an odd multiple of 90 degrees"), (sp.sin, "a multiple of 180 degrees")):
        core = turned.as_coeff_Mul()[1]
        if isinstance(core, kind):
            return f"{core.args[0]} is {about}"
    return f"{written(turned)} = 0"


def _vanishing_factors(
    functions: Functions, above: Sequence[PolyElement], below: Sequence[PolyElement] = ()
) -> list[PolyElement]:
    """Factors of a ratio of products that may vanish, each once, with a positive leading term."""
    powers = {f: power for f, power in functions.product(above, below)[1].items() if not functions.never_zero(f)}
    if any(power < 0 and not functions.is_constant(f) for f, power in powers.items()):
        parts = [[f ** abs(power) for f, power in powers.items() if (power < 0) == negative] for negative in (False, True)]
        ratio = functions.lowest(*(_product(functions, part) for part in parts))
        powers = functions.product(ratio[:1], ())[1]
    return list(dict.fromkeys(f if f.LC > 0 else -f for f in powers if powers[f] > 0 and not functions.never_zero(f)))


def _minor_factors(functions: Functions, fields: Sequence[VectorField]) -> list[PolyElement]:
    """Those of the minor of the fields, as they are named, in the rows of their pivots."""
    above = [part for field in fields for part in (field.vector[field.pivot], *field.below)]
    return _vanishing_factors(functions, above, [part for field in fields for part in field.above])


def _product(functions: Functions, parts: Iterable[PolyElement]) -> PolyElement:
    product = functions.ring.one
    for part in parts:
        product = functions.times(product, part)
    return product


def _hidden(functions: Functions, polynomials: Sequence[PolyElement]) -> list[PolyElement]:
    """Sines and cosines of sums and differences of two angles, where one of these polynomials vanishes.

    Factors of this kind do not show: the functions of an angle have no unique factors.
    """
    gens, found = functions.ring.gens, []
    for a, b in itertools.combinations([angle for angle in functions.angles if angle.sine is not None], 2):
        places = {a.cosine, a.sine, b.cosine, b.sine}
        suspects = [polynomial for polynomial in polynomials if len(polynomial) > 2 and places <= generators_of(polynomial)]
        if suspects:
            ca, sa, cb, sb = (gens[k] for k in (a.cosine, a.sine, b.cosine, b.sine))
            for guess in (ca * cb - sa * sb, ca * cb + sa * sb, sa * cb + ca * sb, sa * cb - ca * sb):
                points = [point for point, _ in (_point_on(functions, (guess,), seed) for seed in range(2)) if point]
                if points and any(not any(point(polynomial) for point in points) for polynomial in suspects):
                    found.append(guess)
    return found


def _judge(
    found: Distribution, factor: PolyElement, known: list[PolyElement], brackets: dict[tuple[Vector, ...], Brackets]
) -> Place | None:
    """What is different where the factor vanishes, and no known place is; None when nothing is."""
    functions = found.functions
    growths, drops, fails, exact = [], False, False, True
    for seed in range(SEEDS):
        point, rational = _point_on(functions, (factor,), seed, known)
        if point is None:
            continue
        try:
            near = tuple(field.whole(functions) for field in found.near(point).fields)
        except TooLarge:
            continue
        exact = exact and rational
        drops = drops or (bool(found.forms) and point.rank([form.whole(functions) for form in found.forms]) < len(found.forms))
        columns = [column.whole(functions) for column in found.fields]
        dependent = bool(found.forms) and point.rank(columns) < len(columns)
        pole = any(not point(part) for column in found.fields for part in column.above)
        fails = fails or found.kinematics.S is not None and (pole or dependent and not drops)
        followed = brackets.setdefault(near, Brackets(functions, near))
        growths.append(followed.growth_at(point, len(found.growth) + MORE_STEPS, found.growth[-1]))
    worst = min(growths, default=())
    if worst == found.growth and not drops and not fails:
        return None
    whole = worst[-1:] == found.growth[-1:]
    return Place(functions.expression(factor), words(functions, factor), worst, whole, drops, fails, exact)


def _point_on(
    functions: Functions, vanishing: Sequence[PolyElement], seed: int, avoiding: Sequence[PolyElement] = ()
) -> tuple[Point | None, bool]:
    """A point where these vanish and those do not, and whether it is rational; None when none is found."""
    if sum(map(len, vanishing)) > TERMS:
        return None, False
    for domain in (MODULAR,) if functions.roots else (QQ, MODULAR):
        for again in range(AVOIDING):
            try:
                point = random_point(functions, seed + again * SEEDS, vanishing, domain)
            except NoPoint:
                break
            if all(map(point, avoiding)):
                return point, domain is QQ
    return None, False


def _doubt(found: Distribution, level: int, known: list[PolyElement]) -> tuple[str, ...]:
    """Empty when the rank of a level is shown not to drop outside the known places: some minors have no other common zero.

    Else those minors. They come from pivots chosen at points where the minors so far vanish.
    """
    functions = found.functions
    minors: list[PolyElement] = []
    waiting: list[tuple[PolyElement, ...]] = [()]
    for seed in range(MINORS):
        if not waiting:
            break
        vanishing = waiting.pop(0)
        point = _point_on(functions, vanishing, seed, known)[0] if vanishing else None
        if vanishing and point is None:
            continue
        try:
            rest = [factor for factor in _minor_factors(functions, _level(found, level, point)) if factor not in known]
        except (TooLarge, ModelError):
            continue
        minors.append(_product(functions, rest))
        if not rest or _no_common_zero(functions, minors):
            return ()
        waiting += [(*vanishing, factor) for factor in rest if factor not in vanishing]
    least = [a for a in minors if not any(b != a and not a.rem(b) for b in minors)]
    return tuple(sorted({written(functions.expression(minor)) for minor in least}))


def _no_common_zero(functions: Functions, polynomials: Sequence[PolyElement]) -> bool:
    """Is it sure, by the sum of their squares, that they do not vanish together?"""
    if sum(map(len, polynomials)) > TERMS:
        return False
    squares = functions.normal(sum((polynomial**2 for polynomial in polynomials), functions.ring.zero))
    return any(map(functions.never_zero, functions.forms(squares)))
