/*
 * noslip_integral.h - integral action: removes the steady error due to a wrong model or a load.
 *
 * A law has no memory. The integral term is added to the desired highest derivative of an output, so that
 *
 *     v = (y_d'' + ki z) + kd (y_d' - y') + kp (y_d - y)    relative degree 2, stable where 0 < ki < kp kd
 *     v = (y_d' + ki z) + kv (y_d - y)                      relative degree 1, stable where 0 < ki and 0 < kv
 *
 * with z the integral of y_d - y. There is one struct for each output with integral action:
 *
 *     noslip_integral_init(&distance, ki, limit);
 *
 * At each call, with the `status` that the last step of the law returned, initially NOSLIP_OK:
 *
 *     labmate_type_iv_circle_output(&law, &state, y);
 *     noslip_integral_step(&distance, reference.distance - y[0], dt, status, &added);
 *     reference.distance_acceleration = added;              plus the desired one, if any; speed_rate for the speed
 *     status = labmate_type_iv_circle_step(&law, &state, &reference, tau);
 *
 * If the output is a heading, use the nearest desired angle (noslip_angle.h).
 *
 * Anti-windup: |z| does not increase while inputs are saturated, nor if ki |z| would exceed the limit; it may always decrease
 * to zero. Hence |added| <= limit at every step, and while a start from z = 0 is saturated, the inputs are those of the law
 * without integral action. Sums are compensated (Kahan), so that float does not lose small steps.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_INTEGRAL_H
#define NOSLIP_INTEGRAL_H

#include "noslip_controller.h"

/* -- double: made from noslip_integral.inc by guarantees/headers.py ---------------------------------------------------- */

/* Integral action of one output: made by init, owned by the caller, to be read only. */
typedef struct noslip_integral {
    double ki;           /* 1/s^3 where it is added to a second derivative, 1/s^2 where to a first */
    double limit;        /* largest value of ki |z| */
    double z;            /* integral of wanted minus actual output, its unit times s */
    double rounded;      /* what rounding has put too much into z */
    double error;        /* of the last step: it counts until the next */
    double added;        /* ki z, never beyond the limit */
    int ready;
} noslip_integral;

/*
 * Starts at z = 0, with a gain and the largest absolute value that it may add (0: no limit), in the unit of what it is added
 * to. NOSLIP_BAD_PARAMETER unless both are finite and not negative. With ki = 0 nothing is added.
 */
static inline int noslip_integral_init(noslip_integral *self, double ki, double limit)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_finite(ki) && ki >= 0 && noslip_limits_ok(&limit, 1))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->ki = ki;
    self->limit = noslip_limit(limit);
    self->z = 0;
    self->rounded = 0;
    self->error = 0;
    self->added = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Starts anew from z: the next step adds ki z, whatever time went by before it. Take z = 0 for a new task; to take over
 * without a bump what another controller added, that divided by ki.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER where ki |z| is beyond the
 * limit.
 */
static inline int noslip_integral_reset(noslip_integral *self, double z)
{
    double added;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite(z)) {
        return NOSLIP_NONFINITE;
    }
    added = self->ki * z;
    if (!noslip_within(added, self->limit)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->z = z;
    self->rounded = 0;
    self->error = 0;
    self->added = added;
    return NOSLIP_OK;
}

/*
 * What to `add`, ki z, at a call that sees an `error`, wanted minus actual output. The error of the call before counts for the
 * dt (s) since then; but it does not make |z| grow where `status`, what the law's step answered then, is not NOSLIP_OK, nor
 * beyond the limit.
 * On an error nothing changes, and what is added is as before (0 where there is none): NOSLIP_NULL, NOSLIP_NOT_READY,
 * NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER (negative dt).
 */
static inline int noslip_integral_step(noslip_integral *self, double error, double dt,
                int status, double *add)
{
    double part, next, rounded, added;
    int shrinks;
    if (add == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        *add = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite(error) && noslip_is_finite(dt)) || dt < 0) {
        *add = self->added;
        return dt < 0 && noslip_is_finite(error) && noslip_is_finite(dt) ? NOSLIP_BAD_PARAMETER
                                                                                                  : NOSLIP_NONFINITE;
    }
    part = self->error * dt - self->rounded;
    next = self->z + part;
    rounded = (next - self->z) - part;
    added = self->ki * next;
    shrinks = noslip_abs(next) <= noslip_abs(self->z);
    /* what shrinks is within the limit anyway; `rounded` is not finite where `next` is not */
    if ((shrinks || status == NOSLIP_OK) && noslip_within(added, self->limit) &&
        noslip_is_finite(rounded)) {
        self->z = next;
        self->rounded = rounded;
        self->added = added;
    } else if ((self->z > 0) != (part > 0)) { /* back, but not beyond zero */
        self->z = 0;
        self->rounded = 0;
        self->added = 0;
    }
    self->error = error;
    *add = self->added;
    return NOSLIP_OK;
}

/* -- float: made from noslip_integral.inc by guarantees/headers.py ----------------------------------------------------- */

/* Integral action of one output: made by init, owned by the caller, to be read only. */
typedef struct noslip_integral_f {
    float ki;            /* 1/s^3 where it is added to a second derivative, 1/s^2 where to a first */
    float limit;         /* largest value of ki |z| */
    float z;             /* integral of wanted minus actual output, its unit times s */
    float rounded;       /* what rounding has put too much into z */
    float error;         /* of the last step: it counts until the next */
    float added;         /* ki z, never beyond the limit */
    int ready;
} noslip_integral_f;

/*
 * Starts at z = 0, with a gain and the largest absolute value that it may add (0: no limit), in the unit of what it is added
 * to. NOSLIP_BAD_PARAMETER unless both are finite and not negative. With ki = 0 nothing is added.
 */
static inline int noslip_integral_init_f(noslip_integral_f *self, float ki, float limit)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_finite_f(ki) && ki >= 0 && noslip_limits_ok_f(&limit, 1))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->ki = ki;
    self->limit = noslip_limit_f(limit);
    self->z = 0;
    self->rounded = 0;
    self->error = 0;
    self->added = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Starts anew from z: the next step adds ki z, whatever time went by before it. Take z = 0 for a new task; to take over
 * without a bump what another controller added, that divided by ki.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER where ki |z| is beyond the
 * limit.
 */
static inline int noslip_integral_reset_f(noslip_integral_f *self, float z)
{
    float added;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite_f(z)) {
        return NOSLIP_NONFINITE;
    }
    added = self->ki * z;
    if (!noslip_within_f(added, self->limit)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->z = z;
    self->rounded = 0;
    self->error = 0;
    self->added = added;
    return NOSLIP_OK;
}

/*
 * What to `add`, ki z, at a call that sees an `error`, wanted minus actual output. The error of the call before counts for the
 * dt (s) since then; but it does not make |z| grow where `status`, what the law's step answered then, is not NOSLIP_OK, nor
 * beyond the limit.
 * On an error nothing changes, and what is added is as before (0 where there is none): NOSLIP_NULL, NOSLIP_NOT_READY,
 * NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER (negative dt).
 */
static inline int noslip_integral_step_f(noslip_integral_f *self, float error, float dt,
                  int status, float *add)
{
    float part, next, rounded, added;
    int shrinks;
    if (add == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        *add = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite_f(error) && noslip_is_finite_f(dt)) || dt < 0) {
        *add = self->added;
        return dt < 0 && noslip_is_finite_f(error) && noslip_is_finite_f(dt) ? NOSLIP_BAD_PARAMETER
                                                                                                  : NOSLIP_NONFINITE;
    }
    part = self->error * dt - self->rounded;
    next = self->z + part;
    rounded = (next - self->z) - part;
    added = self->ki * next;
    shrinks = noslip_abs_f(next) <= noslip_abs_f(self->z);
    /* what shrinks is within the limit anyway; `rounded` is not finite where `next` is not */
    if ((shrinks || status == NOSLIP_OK) && noslip_within_f(added, self->limit) &&
        noslip_is_finite_f(rounded)) {
        self->z = next;
        self->rounded = rounded;
        self->added = added;
    } else if ((self->z > 0) != (part > 0)) { /* back, but not beyond zero */
        self->z = 0;
        self->rounded = 0;
        self->added = 0;
    }
    self->error = error;
    *add = self->added;
    return NOSLIP_OK;
}

/* -- end of what is made ----------------------------------------------------------------------------------------------- */

#endif
