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

/* -- double: made from noslip_angle.inc by guarantees/headers.py ------------------------------------------------------- */

/*
 * The angle (rad) that differs from `wanted` by whole turns and is nearest to `actual`: not more than half a turn away. `wanted`
 * itself, unchanged, where that is so already. Half a turn away, either way is as short: rounding decides.
 * The error is that of rounding once or twice at the size of the angles: 1e-15 of the larger one in double, 2e-7 in float.
 *
 * NOSLIP_NULL; NOSLIP_NONFINITE; NOSLIP_RANGE where an angle is beyond the range of noslip_sincos. On an error the answer is 0.
 */
static inline int noslip_nearest_angle(double wanted, double actual, double *nearest)
{
    double turns;
    int status = NOSLIP_OK;
    if (nearest == NULL) {
        return NOSLIP_NULL;
    }
    if (!(noslip_is_finite(wanted) && noslip_is_finite(actual))) {
        status = NOSLIP_NONFINITE;
    } else if (!(noslip_angle_ok(wanted) && noslip_angle_ok(actual))) {
        status = NOSLIP_RANGE;
    }
    if (status != NOSLIP_OK) {
        *nearest = 0;
        return status;
    }
    turns = (wanted - actual) * (double)0.15915494309189535;
    turns = (double)(int32_t)(turns + (double)(turns < 0 ? -1 : 1) / 2);
    /* a turn is cut in two, the first part so short that its product with `turns` is exact */
    *nearest = (wanted - turns * (double)6.283203125) + turns * (double)1.7817820413527695e-05;
    return NOSLIP_OK;
}

/* -- float: made from noslip_angle.inc by guarantees/headers.py -------------------------------------------------------- */

/*
 * The angle (rad) that differs from `wanted` by whole turns and is nearest to `actual`: not more than half a turn away. `wanted`
 * itself, unchanged, where that is so already. Half a turn away, either way is as short: rounding decides.
 * The error is that of rounding once or twice at the size of the angles: 1e-15 of the larger one in double, 2e-7 in float.
 *
 * NOSLIP_NULL; NOSLIP_NONFINITE; NOSLIP_RANGE where an angle is beyond the range of noslip_sincos. On an error the answer is 0.
 */
static inline int noslip_nearest_angle_f(float wanted, float actual, float *nearest)
{
    float turns;
    int status = NOSLIP_OK;
    if (nearest == NULL) {
        return NOSLIP_NULL;
    }
    if (!(noslip_is_finite_f(wanted) && noslip_is_finite_f(actual))) {
        status = NOSLIP_NONFINITE;
    } else if (!(noslip_angle_ok_f(wanted) && noslip_angle_ok_f(actual))) {
        status = NOSLIP_RANGE;
    }
    if (status != NOSLIP_OK) {
        *nearest = 0;
        return status;
    }
    turns = (wanted - actual) * (float)0.15915494309189535;
    turns = (float)(int32_t)(turns + (float)(turns < 0 ? -1 : 1) / 2);
    /* a turn is cut in two, the first part so short that its product with `turns` is exact */
    *nearest = (wanted - turns * (float)6.283203125) + turns * (float)1.7817820413527695e-05;
    return NOSLIP_OK;
}

/* -- end of what is made ----------------------------------------------------------------------------------------------- */

#endif
