/*
 * noslip_angle.h - a desired angle, shifted by whole turns to be nearest to the actual one.
 *
 * The outer loop computes desired minus actual value. If an output is a heading (Types II and III) and the two differ by whole
 * turns, the robot would turn that many times. To avoid this, call before each step:
 *
 *     noslip_nearest_angle(desired_heading, state.phi, &reference.heading);
 *
 * The function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_ANGLE_H
#define NOSLIP_ANGLE_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"
#include "noslip_trig.h"

/* -- double: generated from noslip_angle.inc by guarantees/headers.py -------------------------------------------------- */

/*
 * Writes to `nearest` the angle (rad) that differs from `desired` by whole turns and from `actual` by at most half a turn. If
 * `desired` itself is that angle, it is written unchanged. At exactly half a turn, rounding decides between the two candidates.
 * The rounding error is at most 1e-15 times the larger angle in double, 2e-7 in float.
 *
 * Errors: NOSLIP_NULL; NOSLIP_NONFINITE; NOSLIP_RANGE if an angle is outside the range of noslip_sincos. `nearest` is then 0.
 */
static inline int noslip_nearest_angle(double desired, double actual, double *nearest)
{
    double turns;
    int status = NOSLIP_OK;
    if (nearest == NULL) {
        return NOSLIP_NULL;
    }
    if (!(noslip_is_finite(desired) && noslip_is_finite(actual))) {
        status = NOSLIP_NONFINITE;
    } else if (!(noslip_angle_ok(desired) && noslip_angle_ok(actual))) {
        status = NOSLIP_RANGE;
    }
    if (status != NOSLIP_OK) {
        *nearest = 0;
        return status;
    }
    turns = (desired - actual) * (double)0.15915494309189535;
    turns = (double)(int32_t)(turns + (double)(turns < 0 ? -1 : 1) / 2);
    /* 2 pi in two parts; the first has so few bits that its product with `turns` is exact */
    *nearest = (desired - turns * (double)6.283203125) + turns * (double)1.7817820413527695e-05;
    return NOSLIP_OK;
}

/* -- float: generated from noslip_angle.inc by guarantees/headers.py --------------------------------------------------- */

/*
 * Writes to `nearest` the angle (rad) that differs from `desired` by whole turns and from `actual` by at most half a turn. If
 * `desired` itself is that angle, it is written unchanged. At exactly half a turn, rounding decides between the two candidates.
 * The rounding error is at most 1e-15 times the larger angle in double, 2e-7 in float.
 *
 * Errors: NOSLIP_NULL; NOSLIP_NONFINITE; NOSLIP_RANGE if an angle is outside the range of noslip_sincos. `nearest` is then 0.
 */
static inline int noslip_nearest_angle_f(float desired, float actual, float *nearest)
{
    float turns;
    int status = NOSLIP_OK;
    if (nearest == NULL) {
        return NOSLIP_NULL;
    }
    if (!(noslip_is_finite_f(desired) && noslip_is_finite_f(actual))) {
        status = NOSLIP_NONFINITE;
    } else if (!(noslip_angle_ok_f(desired) && noslip_angle_ok_f(actual))) {
        status = NOSLIP_RANGE;
    }
    if (status != NOSLIP_OK) {
        *nearest = 0;
        return status;
    }
    turns = (desired - actual) * (float)0.15915494309189535;
    turns = (float)(int32_t)(turns + (float)(turns < 0 ? -1 : 1) / 2);
    /* 2 pi in two parts; the first has so few bits that its product with `turns` is exact */
    *nearest = (desired - turns * (float)6.283203125) + turns * (float)1.7817820413527695e-05;
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
