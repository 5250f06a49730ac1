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

/* -- double: generated from noslip_reversing.inc by guarantees/headers.py ---------------------------------------------- */

/* Returns 1 if the heading diverges: forward speed (m/s) and lookahead L + d (m) have opposite signs. */
static inline int noslip_diverges(double speed, double lookahead)
{
    return (speed > 0 && lookahead < 0) || (speed < 0 && lookahead > 0);
}

/*
 * Selects one of two laws, number 0 or 1, for a desired forward speed (m/s). `lookahead` is L + d (m) of each law. `which` is the
 * law in use; it is replaced by the other if mode is NOSLIP_SWITCH and the law in use diverges but the other does not. At speed 0
 * nothing changes. Use the desired speed: the sign of a measured speed near standstill is noise. Switch at standstill, because
 * P_l jumps from one side of the axle to the other.
 *
 * Returns NOSLIP_UNSTABLE if the law diverges and mode is NOSLIP_REFUSE, or NOSLIP_SWITCH and the other law does not help; never
 * if mode is NOSLIP_ALLOW. Other errors: NOSLIP_NULL, NOSLIP_NONFINITE; NOSLIP_BAD_PARAMETER for an unknown mode or law. On an
 * error `which` does not change.
 */
static inline int noslip_reversing(int mode, double speed, const double lookahead[2], int *which)
{
    int other;
    if (lookahead == NULL || which == NULL) {
        return NOSLIP_NULL;
    }
    if ((mode != NOSLIP_REFUSE && mode != NOSLIP_SWITCH && mode != NOSLIP_ALLOW) || (*which != 0 && *which != 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (!(noslip_is_finite(speed) && noslip_is_finite(lookahead[0]) &&
          noslip_is_finite(lookahead[1]))) {
        return NOSLIP_NONFINITE;
    }
    if (mode == NOSLIP_ALLOW || !noslip_diverges(speed, lookahead[*which])) {
        return NOSLIP_OK;
    }
    other = 1 - *which;
    /* a lookahead of 0 does not help: the law is singular there */
    if (mode == NOSLIP_REFUSE || !noslip_diverges(-speed, lookahead[other])) {
        return NOSLIP_UNSTABLE;
    }
    *which = other;
    return NOSLIP_OK;
}

/* -- float: generated from noslip_reversing.inc by guarantees/headers.py ----------------------------------------------- */

/* Returns 1 if the heading diverges: forward speed (m/s) and lookahead L + d (m) have opposite signs. */
static inline int noslip_diverges_f(float speed, float lookahead)
{
    return (speed > 0 && lookahead < 0) || (speed < 0 && lookahead > 0);
}

/*
 * Selects one of two laws, number 0 or 1, for a desired forward speed (m/s). `lookahead` is L + d (m) of each law. `which` is the
 * law in use; it is replaced by the other if mode is NOSLIP_SWITCH and the law in use diverges but the other does not. At speed 0
 * nothing changes. Use the desired speed: the sign of a measured speed near standstill is noise. Switch at standstill, because
 * P_l jumps from one side of the axle to the other.
 *
 * Returns NOSLIP_UNSTABLE if the law diverges and mode is NOSLIP_REFUSE, or NOSLIP_SWITCH and the other law does not help; never
 * if mode is NOSLIP_ALLOW. Other errors: NOSLIP_NULL, NOSLIP_NONFINITE; NOSLIP_BAD_PARAMETER for an unknown mode or law. On an
 * error `which` does not change.
 */
static inline int noslip_reversing_f(int mode, float speed, const float lookahead[2], int *which)
{
    int other;
    if (lookahead == NULL || which == NULL) {
        return NOSLIP_NULL;
    }
    if ((mode != NOSLIP_REFUSE && mode != NOSLIP_SWITCH && mode != NOSLIP_ALLOW) || (*which != 0 && *which != 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (!(noslip_is_finite_f(speed) && noslip_is_finite_f(lookahead[0]) &&
          noslip_is_finite_f(lookahead[1]))) {
        return NOSLIP_NONFINITE;
    }
    if (mode == NOSLIP_ALLOW || !noslip_diverges_f(speed, lookahead[*which])) {
        return NOSLIP_OK;
    }
    other = 1 - *which;
    /* a lookahead of 0 does not help: the law is singular there */
    if (mode == NOSLIP_REFUSE || !noslip_diverges_f(-speed, lookahead[other])) {
        return NOSLIP_UNSTABLE;
    }
    *which = other;
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
