/*
 * noslip_reversing.h - checks that the speed has the sign that path following requires.
 *
 * If P_l follows a path, the heading error of the vehicle varies as exp(-v t / l), with forward speed v and l = L + d, the
 * distance of P_l ahead of the axle. If the two have opposite signs, the heading diverges from the path. P_l must be ahead of the
 * axle when driving forward and behind it in reverse.
 *
 * The function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_REVERSING_H
#define NOSLIP_REVERSING_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"

/* -- double: made from noslip_reversing.inc by guarantees/headers.py --------------------------------------------------- */

/* 1 if the heading diverges: a forward speed (m/s) and a distance ahead of the axle (m) with opposite signs. */
static inline int noslip_diverges(double speed, double lever)
{
    return (speed > 0 && lever < 0) || (speed < 0 && lever > 0);
}

/*
 * Which of two laws to use, number 0 or 1, at a wanted forward speed (m/s). `lever` is L + d (m) of each. `which` holds the
 * law in use and is changed to the other where mode is NOSLIP_SWITCH, the law in use diverges and the other does not. At speed
 * 0 nothing changes. Give it the speed wanted: a measured one changes its sign at a standstill as noise will have it. Switch at
 * a standstill: P_l jumps from one side of the axle to the other.
 *
 * NOSLIP_UNSTABLE where the law diverges and mode is NOSLIP_REFUSE, or NOSLIP_SWITCH and the other is no better; never where it
 * is NOSLIP_ALLOW. NOSLIP_NULL, NOSLIP_NONFINITE; NOSLIP_BAD_PARAMETER for another mode or law. On an error `which` stays.
 */
static inline int noslip_reversing(int mode, double speed, const double lever[2], int *which)
{
    int other;
    if (lever == NULL || which == NULL) {
        return NOSLIP_NULL;
    }
    if ((mode != NOSLIP_REFUSE && mode != NOSLIP_SWITCH && mode != NOSLIP_ALLOW) || (*which != 0 && *which != 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (!(noslip_is_finite(speed) && noslip_is_finite(lever[0]) &&
          noslip_is_finite(lever[1]))) {
        return NOSLIP_NONFINITE;
    }
    if (mode == NOSLIP_ALLOW || !noslip_diverges(speed, lever[*which])) {
        return NOSLIP_OK;
    }
    other = 1 - *which;
    /* a lever of 0 is no better: there the law is singular */
    if (mode == NOSLIP_REFUSE || !noslip_diverges(-speed, lever[other])) {
        return NOSLIP_UNSTABLE;
    }
    *which = other;
    return NOSLIP_OK;
}

/* -- float: made from noslip_reversing.inc by guarantees/headers.py ---------------------------------------------------- */

/* 1 if the heading diverges: a forward speed (m/s) and a distance ahead of the axle (m) with opposite signs. */
static inline int noslip_diverges_f(float speed, float lever)
{
    return (speed > 0 && lever < 0) || (speed < 0 && lever > 0);
}

/*
 * Which of two laws to use, number 0 or 1, at a wanted forward speed (m/s). `lever` is L + d (m) of each. `which` holds the
 * law in use and is changed to the other where mode is NOSLIP_SWITCH, the law in use diverges and the other does not. At speed
 * 0 nothing changes. Give it the speed wanted: a measured one changes its sign at a standstill as noise will have it. Switch at
 * a standstill: P_l jumps from one side of the axle to the other.
 *
 * NOSLIP_UNSTABLE where the law diverges and mode is NOSLIP_REFUSE, or NOSLIP_SWITCH and the other is no better; never where it
 * is NOSLIP_ALLOW. NOSLIP_NULL, NOSLIP_NONFINITE; NOSLIP_BAD_PARAMETER for another mode or law. On an error `which` stays.
 */
static inline int noslip_reversing_f(int mode, float speed, const float lever[2], int *which)
{
    int other;
    if (lever == NULL || which == NULL) {
        return NOSLIP_NULL;
    }
    if ((mode != NOSLIP_REFUSE && mode != NOSLIP_SWITCH && mode != NOSLIP_ALLOW) || (*which != 0 && *which != 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (!(noslip_is_finite_f(speed) && noslip_is_finite_f(lever[0]) &&
          noslip_is_finite_f(lever[1]))) {
        return NOSLIP_NONFINITE;
    }
    if (mode == NOSLIP_ALLOW || !noslip_diverges_f(speed, lever[*which])) {
        return NOSLIP_OK;
    }
    other = 1 - *which;
    /* a lever of 0 is no better: there the law is singular */
    if (mode == NOSLIP_REFUSE || !noslip_diverges_f(-speed, lever[other])) {
        return NOSLIP_UNSTABLE;
    }
    *which = other;
    return NOSLIP_OK;
}

/* -- end of what is made ----------------------------------------------------------------------------------------------- */

#endif
