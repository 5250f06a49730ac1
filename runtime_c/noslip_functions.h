/*
 * noslip_functions.h - the functions of friction laws, bearings and limits: exponential and hyperbolic functions, logarithm,
 * powers, inverse trigonometric functions, sign, minimum, maximum and choices, with the same bits on every target.
 *
 * They use only + - * / and square roots, conversions from and to integers, comparisons, and the bits of one number. A float
 * function uses no double. Errors in units in the last place (ulp) of the result, if it is a normal number:
 *
 *                       float           double
 *   exp, log            below 1 (0.92)  below 1 (0.90)
 *   tanh, sinh, cosh    below 3 (2.6)   below 3 (2.6)
 *   atan                below 2.5 (2.0) below 2.5 (1.8)
 *   asin, acos          below 3.5 (3.3) below 3.5 (2.9)
 *   pow                 below 2.5 (2.0) times (1 + |y log x|), both
 *
 * In parentheses the largest error that tests/c/trig_sweep.c measured, over every float (pow: samples) and over samples of doubles. Exact:
 * exp(0) = 1, log(1) = 0, f(-x) = -f(x) for tanh, sinh, atan and asin, cosh(-x) = cosh(x); |tanh| is never above 1.
 *
 * Outside its domain a function returns NaN (log and pow for x < 0, asin and acos for |x| > 1). exp, sinh and cosh return infinity
 * on overflow, and log(0) is minus infinity. Every function returns NaN for a NaN. Unlike those of the C library, so do minimum,
 * maximum, comparison and choice: an invalid argument makes the result invalid, and the law then returns NOSLIP_NONFINITE.
 *
 * Constants come from tests/trig/fit_coefficients.py (minimax fits).
 */
#ifndef NOSLIP_FUNCTIONS_H
#define NOSLIP_FUNCTIONS_H

#include "noslip_real.h"
#include "noslip_trig.h"

/* 2^n for n in the range of normal numbers. */
static inline float noslip_power_of_two_f(int32_t n)
{
    noslip_bits_f power;
    power.bits = (uint32_t)(n + 127) << 23;
    return power.value;
}

static inline double noslip_power_of_two(int32_t n)
{
    noslip_bits power;
    power.bits = (uint64_t)(n + 1023) << 52;
    return power.value;
}

/*
 * Reduces e^x = 2^n e^r with |r| <= ln(2)/2, approximately. Returns n and writes e^r - 1 in two parts, high + low. x must be in the
 * range in which e^x is neither infinite nor zero.
 */
static inline int32_t noslip_reduced_exp_f(float x, float *high, float *low)
{
    const float shifter = 12582912.0f; /* 1.5 * 2^23 */
    const float n = (x * 1.442695f + shifter) - shifter;
    const float tail = n * 1.4286068e-6f;
    float r, z, c;
    *high = x - n * 0.69314575f; /* exact */
    r = *high - tail;
    z = r * r;
    c = r - z * (0.16666625f + z * -0.0027667128f);
    *low = r * c / (2.0f - c) - tail;
    return (int32_t)n;
}

static inline int32_t noslip_reduced_exp(double x, double *high, double *low)
{
    const double shifter = 6755399441055744.0; /* 1.5 * 2^52 */
    const double n = (x * 1.4426950408889634 + shifter) - shifter;
    const double tail = n * 5.497923018708371e-14;
    double r, z, c;
    *high = x - n * 0.6931471805598903; /* exact */
    r = *high - tail;
    z = r * r;
    c = r - z * (0.16666666666666602 + z * (-0.0027777777777013672 + z * (6.613756320949095e-5 +
        z * (-1.6533901687113898e-6 + z * 4.138117503533108e-8))));
    *low = r * c / (2.0 - c) - tail;
    return (int32_t)n;
}

static inline float noslip_exp_f(float x)
{
    float high, low;
    int32_t n, half;
    if (!(x <= 88.8f)) {
        return x * FLT_MAX; /* infinite, or NaN */
    }
    if (x < -104.0f) {
        return 0;
    }
    n = noslip_reduced_exp_f(x, &high, &low);
    half = n / 2; /* in two steps: 2^n alone can be too large or too small */
    return (1.0f + (high + low)) * noslip_power_of_two_f(half) * noslip_power_of_two_f(n - half);
}

static inline double noslip_exp(double x)
{
    double high, low;
    int32_t n, half;
    if (!(x <= 709.8)) {
        return x * DBL_MAX; /* infinite, or NaN */
    }
    if (x < -745.2) {
        return 0;
    }
    n = noslip_reduced_exp(x, &high, &low);
    half = n / 2; /* in two steps: 2^n alone can be too large or too small */
    return (1.0 + (high + low)) * noslip_power_of_two(half) * noslip_power_of_two(n - half);
}

/*
 * The natural logarithm; minus infinity for 0, NaN below.
 *
 * Method: x = 2^n (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)], s = f / (2 + f), h = f^2 / 2,
 * log(1 + f) = 2 s + s^3 P(s^2) = f - (h - s (h + s^2 P(s^2))).
 */
static inline float noslip_log_f(float x)
{
    noslip_bits_f v;
    int32_t n = -127;
    float f, s, z, p, half, k;
    if (!(x > 0 && x <= FLT_MAX)) {
        v.bits = x < 0 ? 0x7fc00000u : 0xff800000u;
        return x <= 0 ? v.value : x;
    }
    v.value = x;
    if (x < FLT_MIN) {
        v.value = x * 16777216.0f;
        n -= 24;
    }
    v.bits += 0x3f800000u - 0x3f3504f3u; /* the exponent goes up at sqrt(2) and not at 2 */
    n += (int32_t)(v.bits >> 23);
    v.bits = (v.bits & 0x7fffffu) + 0x3f3504f3u;
    k = (float)n;
    f = v.value - 1.0f;
    s = f / (2.0f + f);
    z = s * s;
    half = 0.5f * f * f;
    p = z * (0.66666776f + z * (0.39977583f + z * 0.29870796f));
    return k * 0.69314575f - ((half - (s * (half + p) + k * 1.4286068e-6f)) - f);
}

static inline double noslip_log(double x)
{
    noslip_bits v;
    int32_t n = -1023;
    double f, s, z, p, half, k;
    if (!(x > 0 && x <= DBL_MAX)) {
        v.bits = x < 0 ? 0x7ff8000000000000u : 0xfff0000000000000u;
        return x <= 0 ? v.value : x;
    }
    v.value = x;
    if (x < DBL_MIN) {
        v.value = x * 18014398509481984.0;
        n -= 54;
    }
    v.bits += 0x3ff0000000000000u - 0x3fe6a09e667f3bcdu; /* the exponent goes up at sqrt(2) and not at 2 */
    n += (int32_t)(v.bits >> 52);
    v.bits = (v.bits & 0xfffffffffffffu) + 0x3fe6a09e667f3bcdu;
    k = (double)n;
    f = v.value - 1.0;
    s = f / (2.0 + f);
    z = s * s;
    half = 0.5 * f * f;
    p = z * (0.6666666666666734 + z * (0.3999999999941664 + z * (0.28571428742028104 + z * (0.2222219860507319 +
        z * (0.18183562849625315 + z * (0.15314084904360514 + z * 0.14795632497300854))))));
    return k * 0.6931471805598903 - ((half - (s * (half + p) + k * 5.497923018708371e-14)) - f);
}

/* Returns 1 if e^-2x is lost beside 1, or x is NaN. */
static inline int noslip_saturates_f(float x)
{
    return !(x < 9.1f);
}

static inline int noslip_saturates(double x)
{
    return !(x < 19.1);
}

#define NOSLIP_MODULE "noslip_functions.inc"
#include "noslip_scalars.inc"

#endif
