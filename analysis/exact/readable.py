"""Readable formulas: factors kept, sums collected by sines and cosines or combined into one,
no unnecessary minus signs."""

import sympy as sp
from sympy.simplify.fu import TR10i

LONGEST = 8  # most terms of a sum to which the addition theorems are applied


def readable(expression: sp.Expr) -> sp.Expr:
    """Return the product with its sums collected by sines and cosines, and with the fewest minus signs."""
    coefficient, rest = expression.as_coeff_Mul()
    factors = []
    for part in sp.Mul.make_args(rest):
        base, power = part.as_base_exp()
        if base.is_Add and power.is_Integer:
            base, odd = _collected(_added(base)), int(power % 2)
            turned, negative = _turned(base), int(_is_negative(coefficient))
            if _minuses(turned) + odd * (1 - negative) < _minuses(base) + odd * negative:
                base, coefficient = turned, coefficient * (-1) ** odd
        factors.append(base**power)
    return sp.Mul(coefficient, *factors)


def unsigned(expression: sp.Expr) -> sp.Expr:
    """Return an expression that vanishes where this one does, without a numerical factor."""
    bare = readable(expression).as_coeff_Mul()[1]
    turned = readable(-bare)
    return turned if _minuses(turned) < _minuses(bare) else bare


def _added(base: sp.Add) -> sp.Expr:
    """sin(a)*cos(b) + cos(a)*sin(b) as sin(a + b), if that is shorter."""
    angles = {wave.args[0] for wave in base.atoms(sp.sin, sp.cos)}
    if len(angles) < 2:
        return base
    if len(base.args) <= LONGEST:
        return min((base, TR10i(base)), key=sp.count_ops)
    alike: dict[sp.Expr, list[sp.Expr]] = {}  # by what is not a sine or cosine, up to its sign
    for term in base.args:
        rest = sp.Mul(*[part for part in sp.Mul.make_args(term) if not isinstance(part, sp.sin | sp.cos)])
        alike.setdefault(abs(rest.as_coeff_Mul()[0]) * rest.as_coeff_Mul()[1], []).append(term)
    sums = [sp.Add(*terms) for terms in alike.values()]
    return sp.Add(
        *[min((each, TR10i(each)), key=sp.count_ops) if len(each.args) <= LONGEST else each for each in sums]
    )


def _collected(base: sp.Expr) -> sp.Expr:
    """Collect by the sine and cosine of the angle in which most terms are linear, if any."""
    if not base.is_Add:
        return base
    angles = {
        wave.args[0]
        for term in base.args
        for wave in sp.Mul.make_args(term)
        if isinstance(wave, sp.sin | sp.cos)
    }
    ways = [_by_angle(base, angle) for angle in sorted(angles, key=sp.default_sort_key)]
    return sp.Add(*min(ways, key=len)) if ways else base


def _by_angle(base: sp.Add, angle: sp.Expr) -> list[sp.Expr]:
    waves: dict[sp.Expr, list[sp.Expr]] = {sp.cos(angle): [], sp.sin(angle): []}
    rest: list[sp.Expr] = []
    for term in base.args:
        parts = sp.Mul.make_args(term)
        wave = [part for part in parts if part in waves]
        if len(wave) == 1 and not sp.Mul(*(part for part in parts if part not in waves)).has(*waves):
            waves[wave[0]].append(term / wave[0])
        else:
            rest.append(term)
    for wave, coefficients in waves.items():
        if coefficients:
            total = sp.Add(*coefficients)
            total = sp.factor_terms(total) if len(coefficients) > 1 else total
            rest.append(
                -(_turned(total) * wave)
                if total.is_Add and 2 * _minuses(total) > len(total.args)
                else total * wave
            )
    return rest


def _turned(total: sp.Expr) -> sp.Expr:
    """Return minus the expression, term by term."""
    return sp.Add(*[-term for term in sp.Add.make_args(total)])


def _is_negative(term: sp.Expr) -> bool:
    return bool(term.as_coeff_Mul()[0] < 0)


def _minuses(expression: sp.Expr) -> int:
    return sum(map(_is_negative, sp.Add.make_args(expression)))
