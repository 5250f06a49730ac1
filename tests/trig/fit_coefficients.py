"""Derives every constant of runtime_c/noslip_trig.h and runtime_c/noslip_functions.h and prints it; mpmath is
all it needs.

The polynomials are minimax fits on the reduced interval (Remez exchange), with the coefficients rounded to
the scalar one after the other: after the lowest is rounded, the others are fitted again to what is left, so
that each takes up the rounding of those before it. The parts of pi/2 are cut so that the products named in
the header are exact.
"""

from mpmath import (
    bernoulli,
    cos,
    factorial,
    floor,
    frexp,
    ldexp,
    linspace,
    ln,
    lu_solve,
    matrix,
    mp,
    mpf,
    nint,
    pi,
    sqrt,
    tan,
)

mp.dps = 60


def round_to(bits, x):
    """Nearest number with so many bits of mantissa."""
    _, exponent = frexp(x)
    return ldexp(nint(ldexp(x, bits - exponent)), exponent - bits)


def remez(f, power, terms, upper):
    """Coefficients (lowest first) of the polynomial p that minimises max |z^power (f - p)| on [0, upper]."""
    grid = [upper * (1 - cos(pi * t)) / 2 for t in linspace(mpf(1) / 4000, 1, 2000)]
    values = [(z, f(z), z**power) for z in grid]
    nodes = [values[round((i + mpf(1) / 2) * (len(grid) - 1) / (terms + 1))] for i in range(terms + 1)]
    for _ in range(30):
        rows = [[z**k for k in range(terms)] + [(-1) ** i / w] for i, (z, _, w) in enumerate(nodes)]
        *p, level = lu_solve(matrix(rows), matrix([v for _, v, _ in nodes]))
        peaks = []  # the largest error between two changes of sign
        for z, v, w in values:
            e = w * (v - sum(c * z**k for k, c in enumerate(p)))
            if peaks and (e > 0) == (peaks[-1][0] > 0):
                peaks[-1] = max(peaks[-1], (e, (z, v, w)), key=lambda peak: abs(peak[0]))
            else:
                peaks.append((e, (z, v, w)))
        while len(peaks) > terms + 1:
            peaks.pop(0 if abs(peaks[0][0]) < abs(peaks[-1][0]) else -1)
        nodes = [node for _, node in peaks]
        if max(abs(e) for e, _ in peaks) < abs(level) * (1 + mpf(10) ** -6):
            return p
    raise ArithmeticError("the exchange did not converge")


def fit(f, power, terms, upper, bits):
    """Rounded coefficients and the error they leave."""
    rounded = []

    def rest(z):
        return (f(z) - sum(c * z**k for k, c in enumerate(rounded))) / z ** len(rounded)

    while len(rounded) < terms:
        p = remez(rest, power + len(rounded), terms - len(rounded), upper)
        rounded.append(round_to(bits, p[0]))
    error = max(abs(rest(z) * z ** (power + terms)) for z in linspace(upper / 500, upper, 500))
    return rounded, error


def series(shift):
    """sum over k >= 0 of (-z)^k / (2k + shift)!: sine and cosine without their first terms,
    free of cancellation."""
    return lambda z: sum((-z) ** k / factorial(2 * k + shift) for k in range(25))


def arctangent(z):
    """(atan(r)/r - 1)/z at z = r^2, free of cancellation."""
    return sum((-1) ** (k + 1) * z**k / (2 * k + 3) for k in range(80))


def half_tangent(z):
    """(tan(r/2)/r - 1/2)/z at z = r^2, free of cancellation."""
    return sum(
        (-1) ** (k + 1) * 2 * (4 ** (k + 2) - 1) * bernoulli(2 * k + 4) / factorial(2 * k + 4) * z**k
        for k in range(40)
    )


def exponential(z):
    """(r coth(r/2) - 2)/z at z = r^2, free of cancellation."""
    return sum(2 * bernoulli(2 * k + 2) / factorial(2 * k + 2) * z**k for k in range(40))


def logarithm(z):
    """(log((1+s)/(1-s))/s - 2)/z at z = s^2, free of cancellation."""
    return sum(2 * z**k / (2 * k + 3) for k in range(60))


def literal(bits, x):
    """Shortest decimal that reads back as x."""
    digits = next(d for d in range(1, 20) if round_to(bits, mpf(mp.nstr(x, d))) == x)
    return mp.nstr(x, digits) + ("f" if bits == 24 else "")


def show(name, bits, numbers, note=""):
    print(name, ", ".join(literal(bits, x) for x in numbers), note)


def parts(bits, grids, cut):
    """pi/2 cut at each grid 2^-g, the rest rounded."""
    left, out = pi / 2, []
    for g in grids:
        out.append(ldexp(cut(ldexp(left, g)), -g))
        left -= out[-1]
    return out + [round_to(bits, left)]


def main():
    # float: cut to nearest, which leaves so little that two parts do; double: cut downwards, so that no part
    # is negative and sin(-0) stays -0. The error of sine and arctangent is wanted absolute in float, relative
    # in double.
    for (
        name,
        bits,
        largest,
        grids,
        cut,
        power,
        terms,
        atan_terms,
        tan_terms,
        exp_terms,
        log_terms,
        ln2_bits,
    ) in (
        ("float", 24, 8192, [11], nint, mpf(3) / 2, 3, 4, 2, 2, 3, 16),
        ("double", 53, 2**20, [33, 53, 86], floor, mpf(1), 6, 10, 5, 5, 7, 42),
    ):
        upper = (pi / 4 + largest * mpf(2) ** -bits) ** 2  # rounding may miss the nearest multiple by so much
        print(name)
        show("  2/pi", bits, [round_to(bits, 2 / pi)])
        show("  pi/2", bits, parts(bits, grids, cut))
        p, error = fit(series(3), power, terms, upper, bits)
        show("  P in sin r = r - r^3 P(r^2)", bits, p, "error " + mp.nstr(error, 3))
        q, error = fit(series(4), 2, terms, upper, bits)
        show("  Q in cos r = 1 - r^2/2 + r^4 Q(r^2)", bits, q, "error " + mp.nstr(error, 3))
        p, error = fit(arctangent, power, atan_terms, tan(pi / 8) ** 2, bits)
        show("  tan(pi/8)", bits, [round_to(bits, tan(pi / 8))])
        show("  P in atan t = t + t^3 P(t^2)", bits, p, "error " + mp.nstr(error, 3))
        p, error = fit(half_tangent, 1, tan_terms, mpf(1) / 16, bits)
        show("  P in tan(x/2)/x = 1/2 + x^2 P(x^2)", bits, p, "error " + mp.nstr(error, 3))
        p, error = fit(exponential, 1, exp_terms, (ln(2) / 2 * (1 + mpf(2) ** (8 - bits))) ** 2, bits)
        show("  P in e^r = 1 + r + r c/(2 - c), c = r - r^2 P(r^2)", bits, p, "error " + mp.nstr(error, 3))
        p, error = fit(logarithm, 1, log_terms, ((sqrt(2) - 1) / (sqrt(2) + 1)) ** 2, bits)
        show("  P in log((1 + s)/(1 - s)) = 2 s + s^3 P(s^2)", bits, p, "error " + mp.nstr(error, 3))
        high = round_to(ln2_bits, ln(2))  # its products with exponents are exact
        show("  log 2", bits, [high, round_to(bits, ln(2) - high)])
        high = round_to(bits - 2, pi / 4)  # its products with 1, 2, 3 and 4 are exact
        show("  pi/4", bits, [high, round_to(bits, pi / 4 - high)])


if __name__ == "__main__":
    main()
