"""Sine, cosine and the angle of a vector with the same bits on every processor.

The C library and NumPy choose their sine and cosine by processor, some with fused operations, so that the
last bits differ between machines. Here only + - * /, floor and the square root are used, which IEEE 754
defines exactly. The series are Taylor series, so that the fitted polynomials of runtime_c/noslip_trig.h are
compared with an independent computation.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np

if TYPE_CHECKING:  # slow to import
    from casadi import SX

Number = TypeVar("Number", float, np.ndarray, "SX")

# pi/2 in three parts; the first two have 33 bits, so that their product with fewer than 2^20 quarter turns is
# exact
HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
SINE = [(-1) ** k / math.factorial(2 * k + 1) for k in range(1, 9)]  # of r^3, r^5, ...
COSINE = [(-1) ** k / math.factorial(2 * k) for k in range(2, 9)]  # of r^4, r^6, ...
ARCTANGENT = [(-1) ** k / (2 * k + 1) for k in range(1, 7)]  # of t^3, t^5, ...
EIGHTHS = np.array(  # atan(k/8)
    [
        0.0,
        0.12435499454676144,
        0.24497866312686414,
        0.35877067027057225,
        0.4636476090008061,
        0.5585993153435624,
    ]
    + [0.6435011087932844, 0.7188299996216245, 0.7853981633974483]
)


def whole(x: Number) -> Number:
    """Return the largest integer not above x; NaN for infinity."""
    return x // 1.0


def sine_cosine(x: Number, floor: Callable[[Number], Number] = whole) -> tuple[Number, Number]:
    """Return sin x and cos x, x in rad, for a float, an array, or with CasADi's floor for an expression. NaN
    for infinity.

    The absolute error is below 3e-16 for |x| <= 2^20; for larger |x| it is that of an angle which differs
    from x by a rounding error.
    """
    n = floor(x * (2 / math.pi) + 0.5)
    r = ((x - n * HALF_PI[0]) - n * HALF_PI[1]) - n * HALF_PI[2]
    z = r * r
    s, c = r + r * z * _polynomial(SINE, z), 1 - z * (0.5 - z * _polynomial(COSINE, z))
    odd, sine_sign, cosine_sign = (
        _odd(n, floor),
        _odd(floor(n * 0.5), floor),
        _odd(floor((n + 1) * 0.5), floor),
    )
    return (1 - 2 * sine_sign) * ((1 - odd) * s + odd * c), (1 - 2 * cosine_sign) * ((1 - odd) * c + odd * s)


def sine(x: Number) -> Number:
    """Return sin x as computed by `sine_cosine`."""
    return sine_cosine(x)[0]


def cosine(x: Number) -> Number:
    """Return cos x as computed by `sine_cosine`."""
    return sine_cosine(x)[1]


def unit(heading: float) -> complex:
    """Return exp(i heading)."""
    s, c = sine_cosine(heading)
    return complex(c, s)


@overload
def angle_of(y: float, x: float) -> float: ...


@overload
def angle_of(y: np.ndarray, x: np.ndarray) -> np.ndarray: ...


def angle_of(y: float | np.ndarray, x: float | np.ndarray) -> float | np.ndarray:
    """Return the angle in [-pi, pi] of the finite vector (x, y), 0 for (0, 0); the absolute error is below
    1e-15.

    The vector is rotated by the nearest atan(k/8); the remaining angle of at most 1/16 is a short series.
    """
    a, b = np.abs(y), np.abs(x)
    long, short = np.maximum(a, b), np.minimum(a, b)
    scale = np.where(long > 0, long, 1.0)
    t = short / scale
    k = np.floor(8 * t + 0.5)
    u = (t - k / 8) / (1 + t * (k / 8))
    z = u * u
    angle = EIGHTHS[k.astype(int)] + (u + u * z * _polynomial(ARCTANGENT, z))
    angle = np.where(a > b, math.pi / 2 - angle, angle)
    angle = np.where(np.asarray(x) < 0, math.pi - angle, angle)
    angle = np.where(np.asarray(y) < 0, -angle, angle)
    return angle if angle.ndim else float(angle)


def arcsine(x: float) -> float:
    """Return the angle in [-pi/2, pi/2] whose sine is x, |x| <= 1."""
    return angle_of(x, math.sqrt((1 - x) * (1 + x)))


@overload
def phase(z: complex) -> float: ...


@overload
def phase(z: np.ndarray) -> np.ndarray: ...


def phase(z: Any) -> Any:
    """Return the angle of a complex number, or of each element of an array."""
    return angle_of(z.imag, z.real)


def size(z: np.ndarray) -> np.ndarray:
    """Return the absolute values of complex numbers."""
    return np.sqrt(z.real * z.real + z.imag * z.imag)


def product(z: np.ndarray, w: np.ndarray | complex) -> np.ndarray:
    """Return products of complex numbers; NumPy's own product uses fused operations on some processors."""
    return (z.real * w.real - z.imag * w.imag) + 1j * (z.real * w.imag + z.imag * w.real)


def _polynomial(coefficients: list[float], z: Number) -> Number:
    """Return c0 + c1 z + c2 z^2 + ... by Horner's scheme."""
    value = coefficients[-2] + z * coefficients[-1]
    for coefficient in reversed(coefficients[:-2]):
        value = coefficient + z * value
    return value


def _odd(n: Number, floor: Callable[[Number], Number]) -> Number:
    """Return 1 for odd integers, 0 for even ones."""
    return n - 2 * floor(n * 0.5)
