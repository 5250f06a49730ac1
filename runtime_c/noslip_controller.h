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
    NOSLIP_GRIP = 2, /* keeps the wheels rolling and the inputs within their limits: see noslip_grip.h */
    NOSLIP_ON_LIMIT_AS_INT = -0x7fffffff
} noslip_on_limit;

/* Code that runs only on errors is kept apart from the code of every step: NOSLIP_COLD, in a header NOSLIP_APART; code that runs with
 * some options only is NOSLIP_BESIDE. Code of every step is NOSLIP_HOT. In files of the user the compiler decides whether to inline
 * it, and does not inline it into functions that fuse products; in files of this package, which define NOSLIP_OWN, it is always
 * inlined. */
#if defined(__GNUC__)
#define NOSLIP_COLD __attribute__((noinline, cold))
#define NOSLIP_BESIDE __attribute__((noinline))
#define NOSLIP_APART static inline __attribute__((cold))
#if defined(NOSLIP_OWN)
#define NOSLIP_HOT static inline __attribute__((always_inline))
#else
#define NOSLIP_HOT static inline
#endif
#else
#define NOSLIP_COLD
#define NOSLIP_BESIDE
#define NOSLIP_APART static inline
#define NOSLIP_HOT static inline
#endif

/* Copies `size` bytes, without a library. */
NOSLIP_APART void noslip_copy(void *to, const void *from, size_t size)
{
    size_t i;
    for (i = 0; i < size; i++) {
        ((unsigned char *)to)[i] = ((const unsigned char *)from)[i];
    }
}

/* -- double: generated from noslip_controller.inc by guarantees/headers.py --------------------------------------------- */

/* Position of the vehicle relative to the foot of P_l on a path (its closest point), in the frame with x along the path and y to
 * its left. */
typedef struct noslip_foot {
    double distance;          /* m: of P_l from the path, positive to the left */
    double cosine, sine;      /* of the heading relative to the path's direction; in reverse the cosine is near -1 */
    double curvature;         /* 1/m: k / (1 - k distance), that of the parallel curve through P_l; positive turns left */
} noslip_foot;

/* sum += part, compensated (Kahan): `rounded` is the rounding error of the sum so far, which the next addition corrects. */
static inline void noslip_add(double *sum, double *rounded, double part)
{
    const double rest = part - *rounded, before = *sum;
    *sum = before + rest;
    *rounded = (*sum - before) - rest;
}

/* Returns 1 if all `count` values are finite. A sum is finite only if all its terms are, so that one test is usually enough. */
static inline int noslip_all_finite(const double *values, int count)
{
    int i;
#if !defined(__FRAMAC__) /* its intervals cannot infer the terms from the sum */
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

/* Returns 1 if a limit is valid: finite and positive, or zero (no limit). */
static inline int noslip_is_limit(double limit)
{
    return noslip_is_finite(limit) && limit >= 0;
}

/* Returns 1 if all `count` limits are valid. */
static inline int noslip_limits_ok(const double *limits, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        if (!noslip_is_limit(limits[i])) {
            return 0;
        }
    }
    return 1;
}

/* Returns the limit to compare with: the largest finite number if there is no limit, so that a value within it is finite. */
static inline double noslip_limit(double limit)
{
    return limit > 0 ? limit : DBL_MAX;
}

/* Returns x, or the nearer of -limit and limit if it is beyond them; NaN for NaN. */
static inline double noslip_clip(double x, double limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

/* Copies `count` results of an entry point to its output. */
static inline void noslip_write(const double *results, double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = results[i];
    }
}

/* Writes `count` zeros to an output. */
static inline void noslip_write_zeros(double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = 0;
    }
}

/*
 * Brings `count` inputs within their limits (from noslip_limit) by the smallest possible change of the virtual input of the
 * speed. `gradient` is the derivative of the inputs with respect to it; entries below 1e-5 of the largest count as zero. If the
 * other outputs alone require more than the limits, uses the change that minimizes the largest |input| / limit, and divides all
 * inputs by that quotient. Returns NOSLIP_SATURATED if an input exceeded its limit. Otherwise, or if an argument is not finite,
 * returns NOSLIP_OK and leaves the inputs unchanged. Inputs that rounding leaves slightly above a limit, and overflow, are
 * handled by noslip_apply_limits.
 */
static inline int noslip_slow(double *inputs, double *gradient, const double *limits, int count)
{
    double largest = 0, overload = 1, least = -DBL_MAX, most = DBL_MAX, change;
    int i, j, beyond = 0;
    for (i = 0; i < count; i++) {
        const double size = noslip_abs(gradient[i]);
        largest = size > largest ? size : largest;
        beyond = beyond || noslip_abs(inputs[i]) > limits[i];
    }
    if (!beyond || !noslip_all_finite(inputs, count) || !noslip_all_finite(gradient, count)) {
        return NOSLIP_OK;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_abs(gradient[i]) * 100000 > largest)) {
            gradient[i] = 0;
            if (noslip_abs(inputs[i]) > overload * limits[i]) {
                overload = noslip_abs(inputs[i]) / limits[i];
            }
        }
    }
    /* The changes that keep an input within `overload` times its limit form an interval. Intervals have a common point if every
     * two of them intersect. */
    for (i = 1; i < count; i++) {
        for (j = 0; j < i; j++) {
            const double gap = noslip_abs(inputs[i] * gradient[j] - inputs[j] * gradient[i]);
            const double width = limits[i] * noslip_abs(gradient[j]) +
                                      limits[j] * noslip_abs(gradient[i]);
            if (width > 0 && gap > overload * width) {
                overload = gap / width;
            }
        }
    }
    for (i = 0; i < count; i++) {
        if (noslip_abs(gradient[i]) > 0) {
            const double bound = gradient[i] > 0 ? overload * limits[i] : -overload * limits[i];
            const double low = (-bound - inputs[i]) / gradient[i], high = (bound - inputs[i]) / gradient[i];
            least = low > least ? low : least;
            most = high < most ? high : most;
        }
    }
    change = least > 0 ? least : most < 0 ? most : 0;
    for (i = 0; i < count; i++) {
        inputs[i] = (inputs[i] + change * gradient[i]) / overload;
    }
    return NOSLIP_SATURATED;
}

/*
 * Ends a controller's step: limits each entry of `computed` (limits from noslip_limit), stores it in `held` and writes it to
 * `inputs`. On an error writes zeros or the values in `held`, as `on_error` selects. Returns the status: NOSLIP_SATURATED if an
 * input was limited, NOSLIP_NONFINITE if one is not finite.
 */
static inline int noslip_apply_limits(int status, int on_error, const double *limits, double *held,
                            const double *computed, double *inputs, int count)
{
    int i;
    if (status >= 0 && !noslip_all_finite(computed, count)) {
        status = NOSLIP_NONFINITE;
    }
    for (i = 0; i < count; i++) {
        double input = on_error == NOSLIP_HOLD ? held[i] : 0;
        if (status >= 0) {
            input = computed[i];
            if (!noslip_within(input, limits[i])) {
                input = input > 0 ? limits[i] : -limits[i];
                status = status == NOSLIP_OK ? NOSLIP_SATURATED : status;
            }
            held[i] = input;
        }
        inputs[i] = input;
    }
    return status;
}

/* -- float: generated from noslip_controller.inc by guarantees/headers.py ---------------------------------------------- */

/* Position of the vehicle relative to the foot of P_l on a path (its closest point), in the frame with x along the path and y to
 * its left. */
typedef struct noslip_foot_f {
    float distance;           /* m: of P_l from the path, positive to the left */
    float cosine, sine;       /* of the heading relative to the path's direction; in reverse the cosine is near -1 */
    float curvature;          /* 1/m: k / (1 - k distance), that of the parallel curve through P_l; positive turns left */
} noslip_foot_f;

/* sum += part, compensated (Kahan): `rounded` is the rounding error of the sum so far, which the next addition corrects. */
static inline void noslip_add_f(float *sum, float *rounded, float part)
{
    const float rest = part - *rounded, before = *sum;
    *sum = before + rest;
    *rounded = (*sum - before) - rest;
}

/* Returns 1 if all `count` values are finite. A sum is finite only if all its terms are, so that one test is usually enough. */
static inline int noslip_all_finite_f(const float *values, int count)
{
    int i;
#if !defined(__FRAMAC__) /* its intervals cannot infer the terms from the sum */
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

/* Returns 1 if a limit is valid: finite and positive, or zero (no limit). */
static inline int noslip_is_limit_f(float limit)
{
    return noslip_is_finite_f(limit) && limit >= 0;
}

/* Returns 1 if all `count` limits are valid. */
static inline int noslip_limits_ok_f(const float *limits, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        if (!noslip_is_limit_f(limits[i])) {
            return 0;
        }
    }
    return 1;
}

/* Returns the limit to compare with: the largest finite number if there is no limit, so that a value within it is finite. */
static inline float noslip_limit_f(float limit)
{
    return limit > 0 ? limit : FLT_MAX;
}

/* Returns x, or the nearer of -limit and limit if it is beyond them; NaN for NaN. */
static inline float noslip_clip_f(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

/* Copies `count` results of an entry point to its output. */
static inline void noslip_write_f(const float *results, float *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = results[i];
    }
}

/* Writes `count` zeros to an output. */
static inline void noslip_write_zeros_f(float *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        values[i] = 0;
    }
}

/*
 * Brings `count` inputs within their limits (from noslip_limit) by the smallest possible change of the virtual input of the
 * speed. `gradient` is the derivative of the inputs with respect to it; entries below 1e-5 of the largest count as zero. If the
 * other outputs alone require more than the limits, uses the change that minimizes the largest |input| / limit, and divides all
 * inputs by that quotient. Returns NOSLIP_SATURATED if an input exceeded its limit. Otherwise, or if an argument is not finite,
 * returns NOSLIP_OK and leaves the inputs unchanged. Inputs that rounding leaves slightly above a limit, and overflow, are
 * handled by noslip_apply_limits.
 */
static inline int noslip_slow_f(float *inputs, float *gradient, const float *limits, int count)
{
    float largest = 0, overload = 1, least = -FLT_MAX, most = FLT_MAX, change;
    int i, j, beyond = 0;
    for (i = 0; i < count; i++) {
        const float size = noslip_abs_f(gradient[i]);
        largest = size > largest ? size : largest;
        beyond = beyond || noslip_abs_f(inputs[i]) > limits[i];
    }
    if (!beyond || !noslip_all_finite_f(inputs, count) || !noslip_all_finite_f(gradient, count)) {
        return NOSLIP_OK;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_abs_f(gradient[i]) * 100000 > largest)) {
            gradient[i] = 0;
            if (noslip_abs_f(inputs[i]) > overload * limits[i]) {
                overload = noslip_abs_f(inputs[i]) / limits[i];
            }
        }
    }
    /* The changes that keep an input within `overload` times its limit form an interval. Intervals have a common point if every
     * two of them intersect. */
    for (i = 1; i < count; i++) {
        for (j = 0; j < i; j++) {
            const float gap = noslip_abs_f(inputs[i] * gradient[j] - inputs[j] * gradient[i]);
            const float width = limits[i] * noslip_abs_f(gradient[j]) +
                                      limits[j] * noslip_abs_f(gradient[i]);
            if (width > 0 && gap > overload * width) {
                overload = gap / width;
            }
        }
    }
    for (i = 0; i < count; i++) {
        if (noslip_abs_f(gradient[i]) > 0) {
            const float bound = gradient[i] > 0 ? overload * limits[i] : -overload * limits[i];
            const float low = (-bound - inputs[i]) / gradient[i], high = (bound - inputs[i]) / gradient[i];
            least = low > least ? low : least;
            most = high < most ? high : most;
        }
    }
    change = least > 0 ? least : most < 0 ? most : 0;
    for (i = 0; i < count; i++) {
        inputs[i] = (inputs[i] + change * gradient[i]) / overload;
    }
    return NOSLIP_SATURATED;
}

/*
 * Ends a controller's step: limits each entry of `computed` (limits from noslip_limit), stores it in `held` and writes it to
 * `inputs`. On an error writes zeros or the values in `held`, as `on_error` selects. Returns the status: NOSLIP_SATURATED if an
 * input was limited, NOSLIP_NONFINITE if one is not finite.
 */
static inline int noslip_apply_limits_f(int status, int on_error, const float *limits, float *held,
                            const float *computed, float *inputs, int count)
{
    int i;
    if (status >= 0 && !noslip_all_finite_f(computed, count)) {
        status = NOSLIP_NONFINITE;
    }
    for (i = 0; i < count; i++) {
        float input = on_error == NOSLIP_HOLD ? held[i] : 0;
        if (status >= 0) {
            input = computed[i];
            if (!noslip_within_f(input, limits[i])) {
                input = input > 0 ? limits[i] : -limits[i];
                status = status == NOSLIP_OK ? NOSLIP_SATURATED : status;
            }
            held[i] = input;
        }
        inputs[i] = input;
    }
    return status;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
