/*
 * noslip_controller.h - checks around a generated law: finite arguments, limits, safe outputs.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_CONTROLLER_H
#define NOSLIP_CONTROLLER_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"
#include "noslip_trig.h"

/* The value of `ready` in a law that init has accepted: unlikely in memory that was never initialized, and an immediate
 * operand on Thumb. */
#define NOSLIP_READY 0x5e5e5e5e

/* What a step does if inputs exceed their limits. */
typedef enum noslip_on_limit {
    NOSLIP_CUT = 0,  /* limits each input separately */
    NOSLIP_SLOW = 1, /* reduces the desired acceleration, so that the other outputs, such as the path, are not affected */
    NOSLIP_ON_LIMIT_AS_INT = -0x7fffffff
} noslip_on_limit;

/* Code that runs only on errors is kept apart from the code of every step: NOSLIP_COLD, in a header NOSLIP_APART. Code of every
 * step is NOSLIP_HOT. In files of the user the compiler decides whether to inline it, and does not inline it into functions that
 * fuse products; in files of this package, which define NOSLIP_OWN, it is always inlined. */
#if defined(__GNUC__)
#define NOSLIP_COLD __attribute__((noinline, cold))
#define NOSLIP_APART static inline __attribute__((cold))
#if defined(NOSLIP_OWN)
#define NOSLIP_HOT static inline __attribute__((always_inline))
#else
#define NOSLIP_HOT static inline
#endif
#else
#define NOSLIP_COLD
#define NOSLIP_APART static inline
#define NOSLIP_HOT static inline
#endif

/* -- double: made from noslip_controller.inc by guarantees/headers.py -------------------------------------------------- */

/* The vehicle seen from the foot of P_l on a path, x along the path and y to its left: all that a law has to know of it. */
typedef struct noslip_foot {
    double distance;          /* m: of P_l from the path, positive to its left */
    double cosine, sine;      /* of the angle from the path's direction to the vehicle's heading; in reverse the cosine is near -1 */
    double curvature;         /* 1/m: k / (1 - k distance), that of the path's parallel through P_l; positive turns left */
} noslip_foot;

/* sum += part; what rounding puts too much into the sum is kept in `rounded` and taken out the next time (Kahan). */
static inline void noslip_add(double *sum, double *rounded, double part)
{
    const double rest = part - *rounded, before = *sum;
    *sum = before + rest;
    *rounded = (*sum - before) - rest;
}

/* 1 if all `count` values are finite. A sum is finite only if all its parts are, so that mostly one look is enough. */
static inline int noslip_all_finite(const double *values, int count)
{
    int i;
#if !defined(__FRAMAC__) /* which cannot tell the parts from the sum */
    double sum = 0;
    for (i = 0; i < count; i++) {
        sum += values[i];
    }
    if (noslip_is_finite(sum)) {
        return 1;
    }
#endif
    for (i = 0; i < count; i++) {
        if (!noslip_is_finite(values[i])) {
            return 0;
        }
    }
    return 1;
}

/* 1 if all `count` limits can be used: finite, zero (none) or positive. */
static inline int noslip_limits_ok(const double *limits, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        if (!(noslip_is_finite(limits[i]) && limits[i] >= 0)) {
            return 0;
        }
    }
    return 1;
}

/* The limit to compare with: the largest number where there is none, so that what is within it is finite too. */
static inline double noslip_limit(double limit)
{
    return limit > 0 ? limit : DBL_MAX;
}

/* 1 if x is not beyond a limit (from noslip_limit) on either side; 0 for NaN. */
static inline int noslip_within(double x, double limit)
{
#if defined(__FRAMAC__) /* the same, in a form its intervals follow */
    return noslip_is_finite(x) && x >= -limit && x <= limit;
#else
    return noslip_abs(x) <= limit;
#endif
}

/* Writes `count` values that an entry point has made. */
static inline void noslip_write(const double *made, double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = made[i];
    }
}

/* Writes zeros in their place. */
static inline void noslip_write_zeros(double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = 0;
    }
}

/*
 * Brings `count` inputs within their limits (from noslip_limit) by changing what is wanted of the speed as little as can
 * be; `slope` is their derivative by that, taken as zero below 1e-5 of the steepest. Where the other outputs alone ask
 * for more than the limits, takes the change that makes the largest |input| / limit least, and divides all inputs by it.
 * Answers NOSLIP_SATURATED where an input was beyond its limit; else, or where something is not finite, NOSLIP_OK and the
 * inputs as they were. What rounding leaves beyond a limit, or overflows, is for noslip_answer.
 */
static inline int noslip_slow(double *inputs, double *slope, const double *limits, int count)
{
    double steepest = 0, overload = 1, least = -DBL_MAX, most = DBL_MAX, change;
    int i, j, beyond = 0;
    for (i = 0; i < count; i++) {
        const double size = noslip_abs(slope[i]);
        steepest = size > steepest ? size : steepest;
        beyond = beyond || noslip_abs(inputs[i]) > limits[i];
    }
    if (!beyond || !noslip_all_finite(inputs, count) || !noslip_all_finite(slope, count)) {
        return NOSLIP_OK;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_abs(slope[i]) * 100000 > steepest)) {
            slope[i] = 0;
            if (noslip_abs(inputs[i]) > overload * limits[i]) {
                overload = noslip_abs(inputs[i]) / limits[i];
            }
        }
    }
    /* The changes that keep each input within `overload` times its limit are an interval; all meet where every two do. */
    for (i = 1; i < count; i++) {
        for (j = 0; j < i; j++) {
            const double apart = noslip_abs(inputs[i] * slope[j] - inputs[j] * slope[i]);
            const double reach = limits[i] * noslip_abs(slope[j]) +
                                      limits[j] * noslip_abs(slope[i]);
            if (reach > 0 && apart > overload * reach) {
                overload = apart / reach;
            }
        }
    }
    for (i = 0; i < count; i++) {
        if (noslip_abs(slope[i]) > 0) {
            const double bound = slope[i] > 0 ? overload * limits[i] : -overload * limits[i];
            const double low = (-bound - inputs[i]) / slope[i], high = (bound - inputs[i]) / slope[i];
            least = low > least ? low : least;
            most = high < most ? high : most;
        }
    }
    change = least > 0 ? least : most < 0 ? most : 0;
    for (i = 0; i < count; i++) {
        inputs[i] = (inputs[i] + change * slope[i]) / overload;
    }
    return NOSLIP_SATURATED;
}

/*
 * Ends a controller's step: cuts each of the inputs `made` to its limit (from noslip_limit), keeps it in `held` and writes it to
 * `inputs`; on an error writes zeros or what is held, as configured. Returns the status, NOSLIP_SATURATED where an input was cut.
 */
static inline int noslip_answer(int status, int on_error, const double *limits, double *held,
                      const double *made, double *inputs, int count)
{
    int i;
    if (status >= 0 && !noslip_all_finite(made, count)) {
        status = NOSLIP_NONFINITE;
    }
    for (i = 0; i < count; i++) {
        double input = on_error == NOSLIP_HOLD ? held[i] : 0;
        if (status >= 0) {
            input = made[i];
            if (!noslip_within(input, limits[i])) {
                input = input > 0 ? limits[i] : -limits[i];
                status = NOSLIP_SATURATED;
            }
            held[i] = input;
        }
        inputs[i] = input;
    }
    return status;
}

/* -- float: made from noslip_controller.inc by guarantees/headers.py --------------------------------------------------- */

/* The vehicle seen from the foot of P_l on a path, x along the path and y to its left: all that a law has to know of it. */
typedef struct noslip_foot_f {
    float distance;           /* m: of P_l from the path, positive to its left */
    float cosine, sine;       /* of the angle from the path's direction to the vehicle's heading; in reverse the cosine is near -1 */
    float curvature;          /* 1/m: k / (1 - k distance), that of the path's parallel through P_l; positive turns left */
} noslip_foot_f;

/* sum += part; what rounding puts too much into the sum is kept in `rounded` and taken out the next time (Kahan). */
static inline void noslip_add_f(float *sum, float *rounded, float part)
{
    const float rest = part - *rounded, before = *sum;
    *sum = before + rest;
    *rounded = (*sum - before) - rest;
}

/* 1 if all `count` values are finite. A sum is finite only if all its parts are, so that mostly one look is enough. */
static inline int noslip_all_finite_f(const float *values, int count)
{
    int i;
#if !defined(__FRAMAC__) /* which cannot tell the parts from the sum */
    float sum = 0;
    for (i = 0; i < count; i++) {
        sum += values[i];
    }
    if (noslip_is_finite_f(sum)) {
        return 1;
    }
#endif
    for (i = 0; i < count; i++) {
        if (!noslip_is_finite_f(values[i])) {
            return 0;
        }
    }
    return 1;
}

/* 1 if all `count` limits can be used: finite, zero (none) or positive. */
static inline int noslip_limits_ok_f(const float *limits, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        if (!(noslip_is_finite_f(limits[i]) && limits[i] >= 0)) {
            return 0;
        }
    }
    return 1;
}

/* The limit to compare with: the largest number where there is none, so that what is within it is finite too. */
static inline float noslip_limit_f(float limit)
{
    return limit > 0 ? limit : FLT_MAX;
}

/* 1 if x is not beyond a limit (from noslip_limit) on either side; 0 for NaN. */
static inline int noslip_within_f(float x, float limit)
{
#if defined(__FRAMAC__) /* the same, in a form its intervals follow */
    return noslip_is_finite_f(x) && x >= -limit && x <= limit;
#else
    return noslip_abs_f(x) <= limit;
#endif
}

/* Writes `count` values that an entry point has made. */
static inline void noslip_write_f(const float *made, float *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = made[i];
    }
}

/* Writes zeros in their place. */
static inline void noslip_write_zeros_f(float *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = 0;
    }
}

/*
 * Brings `count` inputs within their limits (from noslip_limit) by changing what is wanted of the speed as little as can
 * be; `slope` is their derivative by that, taken as zero below 1e-5 of the steepest. Where the other outputs alone ask
 * for more than the limits, takes the change that makes the largest |input| / limit least, and divides all inputs by it.
 * Answers NOSLIP_SATURATED where an input was beyond its limit; else, or where something is not finite, NOSLIP_OK and the
 * inputs as they were. What rounding leaves beyond a limit, or overflows, is for noslip_answer.
 */
static inline int noslip_slow_f(float *inputs, float *slope, const float *limits, int count)
{
    float steepest = 0, overload = 1, least = -FLT_MAX, most = FLT_MAX, change;
    int i, j, beyond = 0;
    for (i = 0; i < count; i++) {
        const float size = noslip_abs_f(slope[i]);
        steepest = size > steepest ? size : steepest;
        beyond = beyond || noslip_abs_f(inputs[i]) > limits[i];
    }
    if (!beyond || !noslip_all_finite_f(inputs, count) || !noslip_all_finite_f(slope, count)) {
        return NOSLIP_OK;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_abs_f(slope[i]) * 100000 > steepest)) {
            slope[i] = 0;
            if (noslip_abs_f(inputs[i]) > overload * limits[i]) {
                overload = noslip_abs_f(inputs[i]) / limits[i];
            }
        }
    }
    /* The changes that keep each input within `overload` times its limit are an interval; all meet where every two do. */
    for (i = 1; i < count; i++) {
        for (j = 0; j < i; j++) {
            const float apart = noslip_abs_f(inputs[i] * slope[j] - inputs[j] * slope[i]);
            const float reach = limits[i] * noslip_abs_f(slope[j]) +
                                      limits[j] * noslip_abs_f(slope[i]);
            if (reach > 0 && apart > overload * reach) {
                overload = apart / reach;
            }
        }
    }
    for (i = 0; i < count; i++) {
        if (noslip_abs_f(slope[i]) > 0) {
            const float bound = slope[i] > 0 ? overload * limits[i] : -overload * limits[i];
            const float low = (-bound - inputs[i]) / slope[i], high = (bound - inputs[i]) / slope[i];
            least = low > least ? low : least;
            most = high < most ? high : most;
        }
    }
    change = least > 0 ? least : most < 0 ? most : 0;
    for (i = 0; i < count; i++) {
        inputs[i] = (inputs[i] + change * slope[i]) / overload;
    }
    return NOSLIP_SATURATED;
}

/*
 * Ends a controller's step: cuts each of the inputs `made` to its limit (from noslip_limit), keeps it in `held` and writes it to
 * `inputs`; on an error writes zeros or what is held, as configured. Returns the status, NOSLIP_SATURATED where an input was cut.
 */
static inline int noslip_answer_f(int status, int on_error, const float *limits, float *held,
                      const float *made, float *inputs, int count)
{
    int i;
    if (status >= 0 && !noslip_all_finite_f(made, count)) {
        status = NOSLIP_NONFINITE;
    }
    for (i = 0; i < count; i++) {
        float input = on_error == NOSLIP_HOLD ? held[i] : 0;
        if (status >= 0) {
            input = made[i];
            if (!noslip_within_f(input, limits[i])) {
                input = input > 0 ? limits[i] : -limits[i];
                status = NOSLIP_SATURATED;
            }
            held[i] = input;
        }
        inputs[i] = input;
    }
    return status;
}

/* -- end of what is made ----------------------------------------------------------------------------------------------- */

#endif
