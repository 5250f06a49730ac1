"""Ratios of forms in half angles: functions of q in lowest terms, with denominators as products.

cos a = (C^2 - S^2)/(C^2 + S^2) and sin a = 2 C S/(C^2 + S^2) with C = cos(a/2), S = sin(a/2) are ratios of
forms of one degree. Forms factor uniquely, so that a ratio in lowest terms has no factor more than its zeros
and poles require; one of polynomials in cos a and sin a may have (see half_angles).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from math import gcd, prod
from operator import add, sub

from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import Ratio, generators_of
from ...model.errors import ModelError
from .functions import LARGEST_PRODUCT, Functions, TooLarge, Vector
from .half_angles import LARGEST, components, degree_of, halved


@dataclass(frozen=True)
class HalfRatio:
    """above / (number * product of factor^power), where no factor divides `above`."""

    above: PolyElement
    below: Mapping[PolyElement, int]
    number: int = 1

    @property
    def product(self) -> PolyElement:
        """The denominator."""
        return prod(
            (factor**power for factor, power in self.below.items()), start=self.above.ring(self.number)
        )


@dataclass(frozen=True)
class Rates:
    """The rates of the generators along a vector field: a polynomial each, over a common denominator."""

    above: Mapping[int, PolyElement]
    below: HalfRatio


class HalfRatios:
    """Arithmetic of ratios of forms in half angles, in the ring of `functions`. Raises ModelError if these
    have square roots, and TooLarge where a product, or a form that becomes a denominator, has too many terms.
    """

    def __init__(self, functions: Functions):
        if functions.roots:
            raise ModelError(f"{functions.name}: square roots of functions of q are not treated here")
        self.functions = functions
        gens = functions.ring.gens
        self._one = {
            angle.sine: gens[angle.cosine] ** 2 + gens[angle.sine] ** 2 for angle in functions.angles
        }

    def ratio(self, ratio: Ratio) -> HalfRatio:
        """Return a ratio of polynomials in cosines and sines as one of forms."""
        top, bottom = (self.lowest(halved(self.functions, part), self._ones(part)) for part in ratio)
        return self.over(top, bottom)

    def whole(self, ratio: HalfRatio) -> Ratio:
        """Return a ratio of forms as one of polynomials in cosines and sines."""
        above, below = ratio.above, ratio.product
        for angle in self.functions.angles:
            c = self.functions.ring.gens[angle.cosine]
            if max(powers[angle.cosine] + powers[angle.sine] for powers in (*above, *below)) % 2:
                above, below = above * c, below * c
            above, below = (self._doubled(form, angle.cosine, angle.sine) for form in (above, below))
        return self.functions.lowest(self.functions.normal(above), self.functions.normal(below))

    def rates(self, field: Vector) -> Rates:
        """Return the rates of the generators along a vector field: of C half of -S a', of S half of C a'."""
        functions = self.functions
        along, gens = functions.rates_along(field), functions.ring.gens
        found = {k: self.ratio((rate, functions.delta)) for k, rate in enumerate(along) if rate}
        for angle in functions.angles:
            c, s = gens[angle.cosine], gens[angle.sine]
            turning = functions.dot((c, -s), (along[angle.sine], along[angle.cosine]))
            for place, shape in ((angle.cosine, -s), (angle.sine, c)):
                found.pop(place, None)
                if turning:
                    rate = self.ratio((turning, functions.delta))
                    found[place] = self.lowest(shape * rate.above, rate.below, 2 * rate.number)
        common = self._common(found.values())
        return Rates(
            {place: each.above * (common.product.exquo(each.product)) for place, each in found.items()},
            common,
        )

    def rate(self, rates: Rates, ratio: HalfRatio) -> HalfRatio:
        """Return the rate of a ratio along a vector field: the quotient rule, factor by factor."""
        factors = list(ratio.below)
        every = prod(factors, start=self.functions.ring.one)
        total = self._times(self._along(rates, ratio.above), every)
        for factor, power in ratio.below.items():
            slope = self._times(self._along(rates, factor), every.exquo(factor))
            total -= power * self._times(ratio.above, slope)
        below = _sum({factor: power + 1 for factor, power in ratio.below.items()}, rates.below.below)
        return self.lowest(total, below, ratio.number * rates.below.number)

    def times(self, a: HalfRatio, b: HalfRatio) -> HalfRatio:
        """Return the product."""
        return self.lowest(self._times(a.above, b.above), _sum(a.below, b.below), a.number * b.number)

    def over(self, a: HalfRatio, b: HalfRatio) -> HalfRatio:
        """Return the quotient."""
        if len(b.above) > LARGEST:
            raise TooLarge
        factors = dict(components(b.above))
        number = b.above.exquo(
            prod((f**power for f, power in factors.items()), start=self.functions.ring.one)
        )
        return self.lowest(self._times(a.above, b.product), _sum(a.below, factors), a.number * int(number.LC))

    def minus(self, a: HalfRatio, b: HalfRatio) -> HalfRatio:
        """Return the difference."""
        common = self._common((a, b))
        above = [self._times(each.above, common.product.exquo(each.product)) for each in (a, b)]
        return self.lowest(above[0] - above[1], common.below, common.number)

    def lowest(self, above: PolyElement, below: Mapping[PolyElement, int], number: int = 1) -> HalfRatio:
        """Return a ratio in lowest terms, by division by each factor of its denominator."""
        left = {}
        for factor, power in below.items():
            while power and above:
                self.functions.spend(len(above) * len(factor))
                quotient = exact_quotient(above, factor)
                if quotient is None:
                    break
                above, power = quotient, power - 1
            if power and above:
                left[factor] = power
        shared = gcd(int(above.content()), number) if above else number
        sign = -1 if number < 0 else 1
        return HalfRatio(above.quo_ground(sign * shared), left, sign * number // shared)

    def _ones(self, polynomial: PolyElement) -> dict[PolyElement, int]:
        degrees = {self._one[angle.sine]: degree_of(polynomial, angle) for angle in self.functions.angles}
        return {one: degree for one, degree in degrees.items() if degree}

    def _common(self, ratios: Iterable[HalfRatio]) -> HalfRatio:
        """Return the least common denominator, as 1 over it."""
        powers: dict[PolyElement, int] = {}
        number = 1
        for ratio in ratios:
            number = number * ratio.number // gcd(number, ratio.number)
            for factor, power in ratio.below.items():
                powers[factor] = max(power, powers.get(factor, 0))
        return HalfRatio(self.functions.ring.one, powers, number)

    def _along(self, rates: Rates, polynomial: PolyElement) -> PolyElement:
        used = generators_of(polynomial) & rates.above.keys()
        slopes = [(polynomial.diff(self.functions.ring.gens[k]), rates.above[k]) for k in sorted(used)]
        return sum((self._times(slope, rate) for slope, rate in slopes), self.functions.ring.zero)

    def _times(self, a: PolyElement, b: PolyElement) -> PolyElement:
        self.functions.spend(len(a) * len(b))
        if len(a) * len(b) > LARGEST_PRODUCT:
            raise TooLarge
        return a * b

    def _doubled(self, form: PolyElement, cosine: int, sine: int) -> PolyElement:
        """Return a form of even degree in C and S as a polynomial in cosine and sine,
        times 2 to the power of half the degree."""
        ring = self.functions.ring
        c, s = ring.gens[cosine], ring.gens[sine]
        parts = [
            ring.from_dict({_without(powers, cosine, sine): coefficient})
            * ((1 + c) ** (powers[cosine] // 2) * (1 - c) ** (powers[sine] // 2) * s ** (powers[sine] % 2))
            for powers, coefficient in form.terms()
        ]
        return sum(parts, ring.zero)


def exact_quotient(above: PolyElement, factor: PolyElement) -> PolyElement | None:
    """Return the quotient of two polynomials with integer coefficients; None if there is a remainder, which
    is found early.

    SymPy looks for the largest term at every step.
    """
    terms = dict(factor)
    leading = factor.leading_expv()
    top = terms.pop(leading)
    left, waiting = dict(above), [tuple(-power for power in powers) for powers in above]
    heapify(waiting)
    quotient = {}
    while waiting:
        powers = tuple(-power for power in heappop(waiting))
        coefficient = left.pop(powers, 0)
        if not coefficient:
            continue
        place = tuple(map(sub, powers, leading))
        if coefficient % top or min(place) < 0:
            return None
        quotient[place] = coefficient // top
        for other, size in terms.items():
            reached = tuple(map(add, place, other))
            if reached not in left:
                heappush(waiting, tuple(-power for power in reached))
            left[reached] = left.get(reached, 0) - quotient[place] * size
    return above.ring.from_dict(quotient)


def _sum(a: Mapping[PolyElement, int], b: Mapping[PolyElement, int]) -> dict[PolyElement, int]:
    return {**a, **{factor: power + a.get(factor, 0) for factor, power in b.items()}}


def _without(powers: Sequence[int], *places: int) -> tuple[int, ...]:
    return tuple(0 if k in places else power for k, power in enumerate(powers))
