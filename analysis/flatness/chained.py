"""The proof that two functions are flat outputs of a system with two inputs, where they are singular, and the
chained form.

Along the derived flag v_1, ..., v_N without its last field the rates of the two are proportional: v(h) = c
s(v) with a direction c = (c_1, c_2) and a speed s. The direction is known from the motion of h. So are its
rate by the way, the rate of this by the way, and so on: N - 3 functions that with h and the direction
determine q; their rates determine the quasi-velocities. Rates by h_1 in place of the way give the chained
form z_1 = h_1, z_N = h_2, z_(k-1) = z_k' / z_1' (R. M. Murray, Nilpotent bases for a class of nonintegrable
distributions with applications to trajectory generation for nonholonomic systems, 1994).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import prod

from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import Ratio
from ..distributions.distribution import Distribution
from ..exact.functions import TooLarge
from ..exact.half_angles import components, never_zero, no_common_zero
from ..exact.half_ratios import HalfRatio, HalfRatios, Rates

CHAIN = 1_000_000  # most terms that the functions of a proof take, some seconds
CHAINED = 100_000  # most terms that a chained form takes; longer ones are of no use to a reader


@dataclass(frozen=True)
class FlatPair:
    """Two functions that are proved to be flat outputs, and where they do not determine the state.

    Both are at rest where `speed`, s along the columns of S up to a factor, has s' nu = 0, and for all
    velocities where one of `resting` or all of `direction` vanish (empty if they never do). Elsewhere they do
    not determine the state where one of `singular` vanishes, as forms in half angles (None: too large to
    say); `exact`: there, and not only at most there. `chained`: z_1, ..., z_N; empty if too large.
    """

    first: Ratio
    last: Ratio
    speed: tuple[Ratio, ...]
    resting: tuple[PolyElement, ...]
    direction: tuple[PolyElement, ...]
    singular: tuple[PolyElement, ...] | None = None
    exact: bool = False
    chained: tuple[Ratio, ...] = ()


def flat_pair(Delta: Distribution, first: Ratio, last: Ratio) -> FlatPair | None:
    """Return the proof that two functions are flat outputs of a system with two fields, whose derived flag
    grows one by one; None if there is none. Denominators of the functions depend on parameters only. Raises
    TooLarge, and ModelError for functions with square roots.

    It is that of `candidates`; the functions by which h determines the state show where it does. The way is
    the length of the path of h if the norm of c is rational, else h_1, or h_2 if only that never rests where
    the other moves.
    """
    functions, basis = Delta.functions, Delta.derived.basis
    if len(basis) < 3:
        return None
    half = HalfRatios(functions)
    pair = [half.ratio(each) for each in (first, last)]
    along = [half.rates(field.vector) for field in basis]
    rates = [(half.rate(each, pair[0]), half.rate(each, pair[1])) for each in along]
    moving = [rate for rate in rates[:-1] if rate[0].above]
    if not moving:
        return flat_pair(Delta, last, first) if any(rate[1].above for rate in rates[:-1]) else None
    slope = half.over(*reversed(min(moving, key=lambda rate: len(rate[0].above))))
    aside = [half.minus(rate[1], half.times(slope, rate[0])) for rate in rates]
    if any(each.above for each in aside[:-1]) or not aside[-1].above:
        return None
    c = slope.product, slope.above
    norm = _root(c[0] ** 2 + c[1] ** 2)
    if norm is None and never_zero(functions, c[1]) and not never_zero(functions, c[0]):
        return flat_pair(Delta, last, first)
    speed = [half.over(half.rate(half.rates(field.vector), pair[0]), _form(c[0])) for field in Delta.fields]
    if norm:
        speed = [half.times(_form(norm), each) for each in speed]
    if not any(each.above for each in speed):
        return None
    resting = _may_vanish(
        Delta, {form for form, _ in components(functools.reduce(PolyElement.gcd, [s.above for s in speed]))}
    )
    scale = next(each for each in speed if each.above)
    rest = tuple(half.whole(half.over(each, scale)) for each in speed)
    stops = any(never_zero(functions, each) for each in c) or no_common_zero(functions, c)
    found = FlatPair(first, last, rest, tuple(resting), () if stops else c)
    way, one = [rate[0] for rate in rates], _form(functions.ring.one)
    longer = half.over(_form(norm), _form(c[0])) if norm else one  # the path than h_1
    try:
        with functions.within(CHAIN):
            slower = half.over(one, half.times(longer, longer))
            values, diagonal = _chain(
                half,
                along,
                [half.times(longer, each) for each in way],
                lambda k: half.times(slower, half.rate(along[k], slope)),
            )
            if not all(each.above for each in diagonal):
                return None
            across = half.over(aside[-1], longer)
            pivots = [half.ratio((field.vector[field.pivot], functions.ring.one)) for field in basis]
            singular = _may_vanish(
                Delta, _singular([*values, *([] if norm else [slope])], [across, *diagonal], pivots)
            )
    except TooLarge:
        return found
    chained = _chained(half, along, way, (first, slope, last), None if norm else values)
    exact = norm is not None or never_zero(functions, c[0])
    return replace(
        found, singular=tuple(form for form in singular if form not in resting), exact=exact, chained=chained
    )


def _chain(
    half: HalfRatios, along: Sequence[Rates], way: Sequence[HalfRatio], rate: Callable[[int], HalfRatio]
) -> tuple[list[HalfRatio], list[HalfRatio]]:
    """Return the functions that follow one with this `rate` along v_1, ..., v_(N-1), by index from 0, each
    the rate of the one before by the way, and the diagonal of their Jacobian matrix.

    A rate by the way is the same along all fields, but the last of those that are considered; of these the
    simplest is taken. The differential of a function, less the next times that of the way, vanishes on all
    but this last field, on which its value is an entry of the diagonal. The last entry is the determinant of
    two functions on v_1, v_2.
    """
    values, diagonal = [], []
    for last in range(len(along) - 2, 1, -1):
        k = min((k for k in range(last) if way[k].above), key=lambda k: len(way[k].above))
        ratio = half.over(rate(k), way[k])
        diagonal.append(half.minus(rate(last), half.times(ratio, way[last])))
        values.append(ratio)
        rate = partial(_rate, half, along, ratio)
    diagonal.append(half.minus(half.times(rate(0), way[1]), half.times(rate(1), way[0])))
    return values, diagonal


def _rate(half: HalfRatios, along: Sequence[Rates], ratio: HalfRatio, k: int) -> HalfRatio:
    return half.rate(along[k], ratio)


def _chained(
    half: HalfRatios,
    along: Sequence[Rates],
    way: Sequence[HalfRatio],
    known: tuple[Ratio, HalfRatio, Ratio],
    values: list[HalfRatio] | None,
) -> tuple[Ratio, ...]:
    """Return z_1, ..., z_N from z_1, z_(N-1), z_N and, if they are known, the others, last first;
    empty if they are too large."""
    first, slope, last = known
    try:
        with half.functions.within(CHAINED):
            if values is None:
                values, _ = _chain(half, along, way, partial(_rate, half, along, slope))
            return (first, *[half.whole(each) for each in (*reversed(values), slope)], last)
    except TooLarge:
        return ()


def _root(polynomial: PolyElement) -> PolyElement | None:
    """Return the root of a polynomial up to a number; None if it is not a square."""
    parts = components(polynomial)
    return (
        None
        if any(power % 2 for _, power in parts)
        else prod((f ** (p // 2) for f, p in parts), start=polynomial.ring.one)
    )


def _singular(
    values: Sequence[HalfRatio], diagonal: Sequence[HalfRatio], pivots: Sequence[HalfRatio]
) -> set[PolyElement]:
    """Return the components on which one of the functions has a pole, or their Jacobian determinant, the
    product of the diagonal over that of the flag, vanishes or has a pole."""
    powers: dict[PolyElement, int] = {}
    for sign, ratios in ((1, diagonal), (-1, pivots)):
        for ratio in ratios:
            for side, parts in ((sign, components(ratio.above)), (-sign, ratio.below.items())):
                for form, power in parts:
                    powers[form] = powers.get(form, 0) + side * power
    return {form for each in values for form in each.below} | {
        form for form, power in powers.items() if power
    }


def _form(form: PolyElement) -> HalfRatio:
    return HalfRatio(form, {})


def _may_vanish(Delta: Distribution, forms: set[PolyElement]) -> list[PolyElement]:
    return sorted(
        (form for form in forms if not never_zero(Delta.functions, form)),
        key=lambda form: (len(form), str(form)),
    )
