/*
 * noslip_trig.h - sine and cosine together, sin(x) / x, tan(x / 2) / x, and the angle of a vector, with the same bits on every
 * target.
 *
 * Sine and cosine use only + - * and the bits of one number: no division, fused operation, table, library call or branch in the
 * C source.
 *
 *   float,  |x| <= NOSLIP_ANGLE_MAX_F:  absolute error below 1e-7 (measured over every float: 7.9e-8)
 *   double, |x| <= NOSLIP_ANGLE_MAX:    error below 1 ulp (largest measured: 0.90)
 *
 * Exact: sin(-x) = -sin(x), cos(-x) = cos(x), sin(0) = 0, cos(0) = 1, and the magnitude never exceeds 1. Check the angle with
 * noslip_angle_ok first: outside this range the results are undefined and may be infinite or NaN.
 *
 * Method: n = x / (pi/2) rounded to the nearest integer, r = x - n pi/2, polynomials for sine and cosine of r in [-pi/4, pi/4],
 * and n quarter turns. pi/2 is split into parts, all but the last with so few bits that their product with n is exact.
 * The admit comments give Frama-C the bounds for arguments in range, which its intervals cannot find; trig_sweep checks them.
 * All constants come from tests/trig/fit_coefficients.py (minimax fits); tests/c/trig_sweep.c measures the errors.
 */
#ifndef NOSLIP_TRIG_H
#define NOSLIP_TRIG_H

#include "noslip_real.h"

#define NOSLIP_ANGLE_MAX 1048576.0
#define NOSLIP_ANGLE_MAX_F 8192.0f

/* Returns 1 if x is in the range of noslip_sincos, 0 if it is outside, infinite or NaN. */
static inline int noslip_angle_ok(double x)
{
    return noslip_within(x, NOSLIP_ANGLE_MAX);
}

static inline int noslip_angle_ok_f(float x)
{
    return noslip_within_f(x, NOSLIP_ANGLE_MAX_F);
}

/*
 * Returns the number of whole turns nearest to an angle (rad), up to 4e6 turns in float and 2e15 in double. Adding 1.5 * 2^23
 * (double: 2^52) and subtracting it again rounds to an integer.
 */
static inline float noslip_whole_turns_f(float angle)
{
    return (angle * 0.15915494f + 12582912.0f) - 12582912.0f;
}

static inline double noslip_whole_turns(double angle)
{
    return (angle * 0.15915494309189535 + 6755399441055744.0) - 6755399441055744.0;
}

static inline void noslip_sincos_f(float x, float *sine, float *cosine)
{
    /* Adding 1.5 * 2^23 rounds the sum to an integer, which is in its lowest bits. */
    const float shifter = 12582912.0f;
    noslip_bits_f turns;
    float n, y, w, r, z, s, c, s_turned, c_turned;

    turns.value = x * 0.63661975f + shifter;
    n = turns.value - shifter;

    y = x - n * 1.5708008f; /* exact; this part is 3217/2048 */
    w = n * 4.454455e-6f;   /* the difference between this part and pi/2 */
    r = y + w;
    z = r * r;

    /* sin r = y - (r^3 P(z) - w): with y instead of r, so that the rounding error of r has no effect */
    s = y - (r * z * (0.16666651f + z * (-0.008331982f + z * 0.00019495949f)) - w);
    /* cos r = 1 - (z/2 - z^2 Q(z)): halving is exact, so this has one rounding less than the Horner form */
    c = 1.0f - (0.5f * z - z * z * (0.041666646f + z * (-0.0013887301f + z * 2.443067e-5f)));

    s_turned = (turns.bits & 1) ? c : s;
    c_turned = (turns.bits & 1) ? -s : c;
    *sine = (turns.bits & 2) ? -s_turned : s_turned;
    *cosine = (turns.bits & 2) ? -c_turned : c_turned;
    /*@ admit -8192 <= x <= 8192 ==> -1 <= *sine <= 1 && -1 <= *cosine <= 1; */
}

static inline void noslip_sincos(double x, double *sine, double *cosine)
{
    const double shifter = 6755399441055744.0; /* 1.5 * 2^52 */
    noslip_bits turns;
    double n, y, w, r, tail, z, h, one_less_h, s, c, s_turned, c_turned;

    turns.value = x * 0.6366197723675814 + shifter;
    n = turns.value - shifter;

    /* The first two steps are exact. r - tail is the reduced angle with an error of about 2^-120. A double can be as close as 2^-60
     * to a multiple of pi/2, and its sine or cosine must be accurate there too. */
    y = x - n * 1.5707963267341256;
    y = y - n * 6.077094383272197e-11;
    w = n * 6.12323399538461e-17;
    r = y - w;
    tail = (w - (y - r)) + n * 3.5215598651832e-27;
    z = r * r;

    /* sin(r - tail) = r - (r^3 P(z) + tail) */
    s = r - (r * z * (0.16666666666666632 + z * (-0.00833333333332249 + z * (0.00019841269829857798 +
        z * (-2.7557313706999946e-6 + z * (2.5050760240224308e-8 + z * -1.5896909079600978e-10))))) + tail);

    /* cos(r - tail) = 1 - z/2 + z^2 Q(z) + r tail, with the rounding error of 1 - z/2 compensated */
    h = 0.5 * z;
    one_less_h = 1.0 - h;
    c = one_less_h + (((1.0 - one_less_h) - h) + (z * z * (0.0416666666666666 + z * (-0.0013888888888874474 +
        z * (2.480158728967154e-5 + z * (-2.755731440103283e-7 + z * (2.0875729281712837e-9 +
        z * -1.1359934277081767e-11))))) + r * tail));

    s_turned = (turns.bits & 1) ? c : s;
    c_turned = (turns.bits & 1) ? -s : c;
    *sine = (turns.bits & 2) ? -s_turned : s_turned;
    *cosine = (turns.bits & 2) ? -c_turned : c_turned;
    /*@ admit -1048576 <= x <= 1048576 ==> -1 <= *sine <= 1 && -1 <= *cosine <= 1; */
}

/*
 * noslip_sinc - sin(x) / x, and 1 at 0, in the range of noslip_sincos, with the same bits on every target.
 *
 *   float:  absolute error below 1.5e-7 (1.1e-7 found)
 *   double: absolute error below 2.5e-16 (1.7e-16 found)
 *
 * Exact: sinc(-x) = sinc(x), and the magnitude is never above 1. Near 0 it is 1 - x^2/6, without a division.
 */
static inline float noslip_sinc_f(float x)
{
    float sine, cosine;
    if (x > -1e-3f && x < 1e-3f) {
        return 1.0f - x * x * 0.16666667f;
    }
    noslip_sincos_f(x, &sine, &cosine);
    return sine / x;
}

static inline double noslip_sinc(double x)
{
    double sine, cosine;
    if (x > -1e-4 && x < 1e-4) {
        return 1.0 - x * x * 0.16666666666666666;
    }
    noslip_sincos(x, &sine, &cosine);
    return sine / x;
}

/*
 * noslip_half_tanc - tan(x / 2) / x, and 1/2 at 0, for |x| <= 1/4, with the same bits on every target. Undefined for larger |x|.
 *
 *   float:  absolute error below 7e-8 (3.5e-8 found)
 *   double: absolute error below 1.3e-16 (7.1e-17 found)
 */
static inline float noslip_half_tanc_f(float x)
{
    const float z = x * x;
    return 0.5f + z * (0.04166595f + z * 0.004203654f);
}

static inline double noslip_half_tanc(double x)
{
    const double z = x * x;
    return 0.5 + z * (0.0416666666666772 + z * (0.004166666664280801 + z * (0.00042162715959553963 + z * (4.2708217263671306e-5 +
        z * 4.409519911987866e-6))));
}

/* atan(t) - t for |t| <= tan(pi/8); z is t^2. */
static inline float noslip_atan_rest_f(float t, float z)
{
    return t * z * (-0.33332756f + z * (0.19971861f + z * (-0.13824259f + z * 0.079019666f)));
}

static inline double noslip_atan_rest(double t, double z)
{
    return t * z * (-0.3333333333333022 + z * (0.199999999991045 + z * (-0.14285714196511906 + z * (0.11111106702913295 +
        z * (-0.09090783512934762 + z * (0.0769008312654027 + z * (-0.06641244219913213 + z * (0.05693154016768563 +
        z * (-0.04360793836848341 + z * 0.02127975189888684)))))))));
}

/*
 * noslip_atan2 - angle of the vector (x, y), in [-pi, pi], with the same bits on every target.
 *
 *   float:  absolute error below 3e-7 (1.8e-7 found)
 *   double: absolute error below 4e-16 (3.4e-16 found) and below 2.5 ulp (2.25 found)
 *
 * Returns 0 for (0, 0). The sign of a zero is ignored: y = -0 counts as 0, with the angle 0 or pi. Uses only + - *, one division,
 * and comparisons. The arguments must be finite.
 *
 * Method: the angle is m pi/4 + atan t with |t| <= tan(pi/8), a polynomial; the leading part of m pi/4 is exact.
 */
static inline float noslip_atan2_f(float y, float x)
{
    const float a = noslip_abs_f(y), b = noslip_abs_f(x);
    const float scale = a + b > 1.0f ? 0.5f : 1.0f; /* a + b of large numbers must not overflow */
    float over, under, m, t, angle;

    if (a <= 0 && b <= 0) {
        return 0;
    }
    if (a <= 0.41421357f * b) {
        over = a;
        under = b;
        m = 0;
    } else if (b <= 0.41421357f * a) {
        over = -b;
        under = a;
        m = 2;
    } else {
        over = scale * a - scale * b;
        under = scale * a + scale * b;
        m = 1;
    }
    t = over / under;
    if (x < 0) {
        t = -t;
        m = 4.0f - m;
    }
    angle = m * 0.78539824f + (t + (noslip_atan_rest_f(t, t * t) + m * -8.146034e-8f));
    return y < 0 ? -angle : angle;
}

static inline double noslip_atan2(double y, double x)
{
    const double a = noslip_abs(y), b = noslip_abs(x);
    const double scale = a + b > 1.0 ? 0.5 : 1.0;
    double over, under, m, t, angle;

    if (a <= 0 && b <= 0) {
        return 0;
    }
    if (a <= 0.41421356237309503 * b) {
        over = a;
        under = b;
        m = 0;
    } else if (b <= 0.41421356237309503 * a) {
        over = -b;
        under = a;
        m = 2;
    } else {
        over = scale * a - scale * b;
        under = scale * a + scale * b;
        m = 1;
    }
    t = over / under;
    if (x < 0) {
        t = -t;
        m = 4.0 - m;
    }
    angle = m * 0.7853981633974483 + (t + (noslip_atan_rest(t, t * t) + m * 3.061616997868383e-17));
    return y < 0 ? -angle : angle;
}

/*
 * noslip_angle_of - angle of the vector (x, y) whose length is known and positive, in [-pi, pi], with the same bits on every
 * target. Faster than noslip_atan2 if the length has been computed already.
 *
 *   float:  absolute error below 4e-7 (3.3e-7 found)
 *   double: absolute error below 7e-16 (5.8e-16 found)
 *
 * Method: the angle is m pi/2 + 2 atan t with t = smaller component / (length + larger component), |t| <= tan(pi/8).
 */
static inline float noslip_angle_of_f(float y, float x, float length)
{
    const float size = noslip_abs_f(y);
    float over = y, under = x, angle = 0, t;
    if (!(x >= size)) {
        angle = y < 0 ? -1.5707964f : 1.5707964f;
        if (x > -size) {
            over = y < 0 ? x : -x;
            under = size;
        } else {
            over = -y;
            under = -x;
            angle += angle;
        }
    }
    t = over / (length + under);
    return angle + 2 * (t + noslip_atan_rest_f(t, t * t));
}

static inline double noslip_angle_of(double y, double x, double length)
{
    const double size = noslip_abs(y);
    double over = y, under = x, angle = 0, t;
    if (!(x >= size)) {
        angle = y < 0 ? -1.5707963267948966 : 1.5707963267948966;
        if (x > -size) {
            over = y < 0 ? x : -x;
            under = size;
        } else {
            over = -y;
            under = -x;
            angle += angle;
        }
    }
    t = over / (length + under);
    return angle + 2 * (t + noslip_atan_rest(t, t * t));
}

#endif
