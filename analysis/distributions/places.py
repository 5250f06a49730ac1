"""Sets where ranks drop: constraints become dependent, S is undefined, or the growth vector changes."""

import contextlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import sympy as sp
from sympy import QQ
from sympy.polys.rings import PolyElement

from ...model.errors import ModelError
from ..exact.functions import Functions, TooLarge, Vector
from ..exact.half_angles import doubled, expression, factors, never_zero, no_common_zero, product
from ..exact.points import MODULAR, NoPoint, Point, random_point
from ..exact.readable import readable, unsigned
from ..exact.real_points import RealPoint, real_point
from ..exact.symbolic import written
from .brackets import Brackets, Span, VectorField
from .distribution import Distribution

REAL_POINTS = 2  # real points evaluated on each set
SEEDS = 3  # other points evaluated if no real one is found
MORE_STEPS = 3  # levels of brackets beyond the generic number, on a set
AVOIDING = 4  # attempts to avoid other sets
MINORS = 24  # points evaluated to prove that there is no other set
TERMS = 400  # most terms of the forms that must vanish at a point

Shared = TypeVar("Shared")


@dataclass(frozen=True)
class Place:
    """The set where `condition` is zero, and how its generic points differ from others.

    `growth`: the dimensions there, as far as computed. `verified`: they are ranks at real points of the set,
    with many digits; otherwise no real point was found, and they are ranks at points with coordinates modulo
    a prime.
    """

    condition: sp.Expr
    words: str
    growth: tuple[int, ...]
    whole: bool  # whether the growth reaches dim Delta*; otherwise it may do so later
    constraints_drop: bool  # whether the rows of A are dependent there
    velocities_fail: bool  # whether S has a pole or dependent columns there although A is regular
    verified: bool
    at_defaults: bool  # whether it exists for the default parameters, not only for other values

    def undecided(self, generic: tuple[int, ...]) -> bool:
        """Whether no difference was found, but the growth was not computed to its end."""
        return (
            not self.constraints_drop
            and not self.velocities_fail
            and self.growth == generic[: len(self.growth)]
        )

    def text(self) -> str:
        """Return one line."""
        about = []
        if self.constraints_drop:
            about.append("the constraints are dependent")
        if self.velocities_fail:
            about.append("the quasi-velocities fail (a pole of S, or dependent columns): choose others there")
        if self.growth:
            about.append(f"growth ({', '.join(map(str, self.growth))}{'' if self.whole else ', ...'})")
        if not self.verified:
            about.append("modular, not verified: no real point was found")
        elif not self.at_defaults:
            about.append("not for the default parameters")
        return f"{self.words}: {'; '.join(about)}"


@dataclass(frozen=True)
class Places:
    """All places of codimension one; smaller ones are possible where all minors of an entry of `doubts`
    vanish."""

    places: tuple[Place, ...]
    doubts: tuple[tuple[str, ...], ...]

    @property
    def complete(self) -> bool:
        """Whether it is proved that nothing changes anywhere else."""
        return not self.doubts

    def text(self) -> list[str]:
        """Return lines."""
        lines = [place.text() for place in self.places]
        if lines:
            lines.append(
                "these are dimensions at generic points of each set; on smaller subsets they may be lower"
            )
        lines += [
            f"smaller sets are not excluded where these vanish together: {', '.join(minors)}"
            for minors in self.doubts
        ]
        return lines or ["nowhere, proved"]


@dataclass(frozen=True)
class Judgement:
    """The differences on a component, as in Place."""

    growth: tuple[int, ...]
    constraints_drop: bool
    velocities_fail: bool
    verified: bool
    at_defaults: bool


def places(Delta: Distribution) -> Places:
    """Return where the rank of A, of S, or a dimension in the filtration drops.

    If the rank drops on a hypersurface, every minor vanishes there, so that its equation is a factor of any
    minor, such as the product of the pivots. Each factor, by half angles, is then examined at its zeros, with
    the brackets themselves.
    """
    functions = Delta.functions
    candidates = dict.fromkeys(
        _vanishing_factors(functions, [part for column in Delta.fields for part in column.above])
    )
    near: dict[tuple[Vector, ...], Brackets] = {}
    levels = range(0 if Delta.forms else 1, len(Delta.growth) + 1)
    for level in levels:
        candidates.update(dict.fromkeys(_minor_factors(functions, _level(Delta, level, near))))
    judged: dict[PolyElement, Judgement] = {}
    for form in sorted(candidates, key=len):
        judgement = _judge(Delta, form, list(judged), near)
        if judgement is not None:
            judged[form] = judgement
    found_places, doubts = [], list[tuple[str, ...]]()
    for form, judgement in joined(functions, judged).items():
        place = _place(Delta, form, judgement)
        if place.undecided(Delta.growth):
            doubts.append((written(place.condition),))
        else:
            found_places.append(place)
    decided = [
        form
        for form, judgement in judged.items()
        if not _place(Delta, form, judgement).undecided(Delta.growth)
    ]
    doubts += [_doubt(Delta, level, near, decided) for level in levels]
    return Places(tuple(found_places), tuple(dict.fromkeys(doubt for doubt in doubts if doubt)))


def _place(Delta: Distribution, form: PolyElement, judgement: Judgement) -> Place:
    condition = expression(Delta.functions, form)
    whole = judgement.growth[-1:] == Delta.growth[-1:]
    return Place(condition, words(Delta.functions, form), whole=whole, **vars(judgement))


def joined(functions: Functions, judged: dict[PolyElement, Shared]) -> dict[PolyElement, Shared]:
    """Merge pairs of components with the same properties and a shorter common condition,
    such as angles of 0 and 180 degrees."""
    joined = dict(judged)
    for a, b in itertools.combinations(judged, 2):
        if a in joined and b in joined and judged[a] == judged[b] and doubled(functions, a) is None:
            both = doubled(functions, a * b)
            if both is not None and not words(functions, a * b).endswith("= 0"):
                joined = {a * b if form == a else form: value for form, value in joined.items() if form != b}
    return joined


def _level(
    Delta: Distribution, level: int, near: dict[tuple[Vector, ...], Brackets], point: Point | None = None
) -> list[VectorField]:
    """Return the echelon form of fields that span Delta_level generically, level 0 being the rows of A.

    With a point, brackets that are independent there are used if possible, and pivots that do not vanish
    there are preferred. Raises TooLarge, or ModelError for the same reason.
    """
    span = Span(Delta.functions, point=point)
    if level == 0:
        fields: Sequence[VectorField] = Delta.forms
    else:
        about = Delta if point is None else Delta.near(point)
        fields = about.filtration.basis[: Delta.growth[level - 1]]
        if point is not None and point.rank([each.whole(Delta.functions) for each in fields]) < len(fields):
            chosen: list[Vector] = []
            for vector in _brackets(Delta, near, point).up_to(level):
                if point.rank([*chosen, vector]) > len(chosen):
                    chosen.append(vector)
            if len(chosen) == len(fields):
                fields = [VectorField(f"b{k + 1}", level, vector) for k, vector in enumerate(chosen)]
    for each in fields:
        span.add(each)
    return span.fields


def _brackets(
    Delta: Distribution, near: dict[tuple[Vector, ...], Brackets], point: Point | RealPoint
) -> Brackets:
    """Return the brackets of fields that span Delta near the point. `near` caches them."""
    fields = tuple(field.whole(Delta.functions) for field in Delta.near(point).fields)
    return near.setdefault(fields, Brackets(Delta.functions, fields))


def words(functions: Functions, form: PolyElement) -> str:
    """Describe the condition form = 0 for a form in half angles."""
    condition = expression(functions, form)
    turned = sp.fu(condition) if len(form) <= 8 and condition.has(sp.sin) else unsigned(condition)
    core = turned.as_coeff_Mul()[1]
    if isinstance(core, sp.cos | sp.sin):
        twice = sp.expand(2 * core.args[0])
        if doubled(functions, form) is None:
            multiple = "an odd multiple of 180" if isinstance(core, sp.cos) else "a multiple of 360"
            return f"{twice} is {multiple} degrees"
        multiple = "an odd multiple of 90" if isinstance(core, sp.cos) else "a multiple of 180"
        return f"{core.args[0]} is {multiple} degrees"
    return f"{written(turned)} = 0"


def _vanishing_factors(
    functions: Functions, above: Sequence[PolyElement], below: Sequence[PolyElement] = ()
) -> list[PolyElement]:
    """Return the components of a ratio of products that may vanish, each once, as forms in half angles with a
    positive leading term."""
    powers: dict[PolyElement, int] = {}
    for sign, parts in ((1, above), (-1, below)):
        for part in dict.fromkeys(parts):
            for form, power in factors(functions, part):
                powers[form] = powers.get(form, 0) + sign * power * parts.count(part)
    return [form for form, power in powers.items() if power > 0 and not never_zero(functions, form)]


def _minor_factors(functions: Functions, fields: Sequence[VectorField]) -> list[PolyElement]:
    """Return the components of the minor of the fields in the rows of their pivots."""
    above = [part for field in fields for part in (field.vector[field.pivot], *field.below)]
    return _vanishing_factors(functions, above, [part for field in fields for part in field.above])


def _judge(
    Delta: Distribution,
    form: PolyElement,
    examined: list[PolyElement],
    near: dict[tuple[Vector, ...], Brackets],
) -> Judgement | None:
    """Return the differences where the form vanishes and none of `examined` does; None if there are none."""
    functions = Delta.functions
    growths, drops, fails = [], [], []
    points, verified = _points_on(Delta, form, examined)
    for point in points:
        try:
            followed = _brackets(Delta, near, point)
        except TooLarge:
            continue
        drop = bool(Delta.forms) and point.rank([form.whole(functions) for form in Delta.forms]) < len(
            Delta.forms
        )
        columns = [column.whole(functions) for column in Delta.fields]
        dependent = bool(Delta.forms) and point.rank(columns) < len(columns)
        pole = any(not point(part) for column in Delta.fields for part in column.above)
        drops.append(drop)
        fails.append(Delta.given and (pole or dependent and not drop))
        growths.append(followed.growth_at(point, len(Delta.growth) + MORE_STEPS, Delta.growth[-1]))
    # At a special point ranks may be lower, so that the largest are those of the component.
    best = max(growths, default=())
    if best == Delta.growth and not all(drops) and not all(fails):
        return None
    at_defaults = all(getattr(point, "at_defaults", True) for point in points)
    return Judgement(best, bool(drops) and all(drops), bool(fails) and all(fails), verified, at_defaults)


def _points_on(
    Delta: Distribution, form: PolyElement, examined: list[PolyElement]
) -> tuple[list[RealPoint | Point], bool]:
    """Return points where the form vanishes and those of `examined` do not: real ones and True,
    or others if none is found."""
    parameters, points = Delta.parameters, list[RealPoint | Point]()
    with contextlib.suppress(NoPoint):
        for seed in range(REAL_POINTS):
            points.append(real_point(Delta.functions, parameters, form, seed, examined))
    if points:
        return points, True
    return [
        point
        for point in (_point_on(Delta.functions, (form,), seed, examined) for seed in range(SEEDS))
        if point
    ], False


def _point_on(
    functions: Functions, vanishing: Sequence[PolyElement], seed: int, avoiding: Sequence[PolyElement] = ()
) -> Point | None:
    """Return a point, rational or modulo a prime, where the former forms vanish and the latter do not;
    None if none is found."""
    if sum(map(len, vanishing)) > TERMS:
        return None
    for domain in (MODULAR,) if functions.roots else (QQ, MODULAR):
        for again in range(AVOIDING):
            try:
                point = random_point(functions, seed + again * SEEDS, vanishing, domain)
            except NoPoint:
                break
            if not any(map(point.on, avoiding)):
                return point
    return None


def _doubt(
    Delta: Distribution, level: int, near: dict[tuple[Vector, ...], Brackets], examined: list[PolyElement]
) -> tuple[str, ...]:
    """Return the minors that were tried; empty if it is proved that the rank of a level drops only at zeros
    of `examined`.

    It is proved if some minors have no other common zero. Their pivots are chosen at points where the minors
    so far vanish.
    """
    functions = Delta.functions
    minors: dict[PolyElement, list[PolyElement]] = {}  # with their factors
    least: list[PolyElement] = []
    waiting: list[tuple[PolyElement, ...]] = [()]
    for seed in range(MINORS):
        if not waiting:
            break
        vanishing = waiting.pop(0)
        point = _point_on(functions, vanishing, seed, examined) if vanishing else None
        if vanishing and point is None:
            continue
        rest = next(
            (factors for minor, factors in minors.items() if point is None or not point.on(minor)), None
        )
        if rest is None:
            try:
                rest = [
                    form
                    for form in _minor_factors(functions, _level(Delta, level, near, point))
                    if form not in examined
                ]
            except (TooLarge, ModelError):
                continue
            minors[product(functions, rest)] = rest
            least = [a for a in minors if not any(b != a and not a.rem(b) for b in minors)]
            if not rest or no_common_zero(functions, least):
                return ()
        waiting += [(*vanishing, form) for form in rest if form not in vanishing]
    return tuple(sorted({written(readable(expression(functions, minor))) for minor in least}))
