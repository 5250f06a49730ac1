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

/* -- double: generated from noslip_integral.inc by guarantees/headers.py ----------------------------------------------- */

/* Integral action of one output: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_integral {
    double ki;           /* 1/s^3 if it is added to a second derivative, 1/s^2 if to a first */
    double limit;        /* maximum of ki |z| */
    double z;            /* integral of desired minus actual output, unit of the output times s */
    double rounded;      /* rounding error of z (Kahan) */
    double error;        /* of the last step: integrated over the time to the next */
    double added;        /* ki z, within the limit */
    int ready;
} noslip_integral;

/*
 * Initializes with z = 0, a gain ki and the maximum of ki |z| (0: no limit), in the unit of the derivative to which it is added.
 * Returns NOSLIP_BAD_PARAMETER unless both are finite and not negative. With ki = 0 nothing is added.
 */
NOSLIP_NODISCARD static inline int noslip_integral_init(noslip_integral *self, double ki, double limit)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_finite(ki) && ki >= 0 && noslip_is_limit(limit))) {
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
 * Restarts from z: the next step adds ki z, independently of its dt. Use z = 0 for a new task. For a bumpless transfer from
 * another controller, use the value that it added, divided by ki.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER if ki |z| exceeds the limit.
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
 * Changes the gain and the maximum of ki |z| between two steps without a jump: z becomes what keeps ki z. `change` is added to it, such as
 * what the other terms of the virtual input lose by a change of their gains, so that their sum stays too; ki z ends at the limit.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER unless ki is positive and the
 * limit not negative.
 */
static inline int noslip_integral_update(noslip_integral *self, double ki, double limit,
                  double change)
{
    double added, z;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_positive(ki) || !noslip_is_limit(limit)) {
        return NOSLIP_BAD_PARAMETER;
    }
    added = noslip_clip(self->added + change, noslip_limit(limit));
    z = added / ki;
    if (!noslip_within(ki * z, noslip_limit(limit))) {                           /* by rounding */
        z *= 1 - 2 * DBL_EPSILON;
    }
    if (!noslip_is_finite(change) || !noslip_is_finite(z)) {
        return NOSLIP_NONFINITE;
    }
    self->ki = ki;
    self->limit = noslip_limit(limit);
    self->z = z;
    self->rounded = 0;
    self->added = ki * z;
    return NOSLIP_OK;
}

/*
 * Writes ki z to `add`. `error` is the desired minus the actual output now. The error of the previous call is integrated over dt
 * (s), the time since that call. |z| does not increase if `status`, which the step of the law returned at the previous call, is
 * not NOSLIP_OK, nor if ki |z| would exceed the limit.
 * On an error nothing changes, and `add` is the previous value, or 0 without `self`: NOSLIP_NULL, NOSLIP_NOT_READY,
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
    /* a smaller |z| is within the limit in any case; `rounded` is not finite if `next` is not */
    if ((shrinks || status == NOSLIP_OK) && noslip_within(added, self->limit) &&
        noslip_is_finite(rounded)) {
        self->z = next;
        self->rounded = rounded;
        self->added = added;
    } else if ((self->z > 0) != (part > 0)) { /* decrease, but not past zero */
        self->z = 0;
        self->rounded = 0;
        self->added = 0;
    }
    self->error = error;
    *add = self->added;
    return NOSLIP_OK;
}

/* -- float: generated from noslip_integral.inc by guarantees/headers.py ------------------------------------------------ */

/* Integral action of one output: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_integral_f {
    float ki;            /* 1/s^3 if it is added to a second derivative, 1/s^2 if to a first */
    float limit;         /* maximum of ki |z| */
    float z;             /* integral of desired minus actual output, unit of the output times s */
    float rounded;       /* rounding error of z (Kahan) */
    float error;         /* of the last step: integrated over the time to the next */
    float added;         /* ki z, within the limit */
    int ready;
} noslip_integral_f;

/*
 * Initializes with z = 0, a gain ki and the maximum of ki |z| (0: no limit), in the unit of the derivative to which it is added.
 * Returns NOSLIP_BAD_PARAMETER unless both are finite and not negative. With ki = 0 nothing is added.
 */
NOSLIP_NODISCARD static inline int noslip_integral_init_f(noslip_integral_f *self, float ki, float limit)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_finite_f(ki) && ki >= 0 && noslip_is_limit_f(limit))) {
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
 * Restarts from z: the next step adds ki z, independently of its dt. Use z = 0 for a new task. For a bumpless transfer from
 * another controller, use the value that it added, divided by ki.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER if ki |z| exceeds the limit.
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
 * Changes the gain and the maximum of ki |z| between two steps without a jump: z becomes what keeps ki z. `change` is added to it, such as
 * what the other terms of the virtual input lose by a change of their gains, so that their sum stays too; ki z ends at the limit.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER unless ki is positive and the
 * limit not negative.
 */
static inline int noslip_integral_update_f(noslip_integral_f *self, float ki, float limit,
                    float change)
{
    float added, z;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_positive_f(ki) || !noslip_is_limit_f(limit)) {
        return NOSLIP_BAD_PARAMETER;
    }
    added = noslip_clip_f(self->added + change, noslip_limit_f(limit));
    z = added / ki;
    if (!noslip_within_f(ki * z, noslip_limit_f(limit))) {                       /* by rounding */
        z *= 1 - 2 * FLT_EPSILON;
    }
    if (!noslip_is_finite_f(change) || !noslip_is_finite_f(z)) {
        return NOSLIP_NONFINITE;
    }
    self->ki = ki;
    self->limit = noslip_limit_f(limit);
    self->z = z;
    self->rounded = 0;
    self->added = ki * z;
    return NOSLIP_OK;
}

/*
 * Writes ki z to `add`. `error` is the desired minus the actual output now. The error of the previous call is integrated over dt
 * (s), the time since that call. |z| does not increase if `status`, which the step of the law returned at the previous call, is
 * not NOSLIP_OK, nor if ki |z| would exceed the limit.
 * On an error nothing changes, and `add` is the previous value, or 0 without `self`: NOSLIP_NULL, NOSLIP_NOT_READY,
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
    /* a smaller |z| is within the limit in any case; `rounded` is not finite if `next` is not */
    if ((shrinks || status == NOSLIP_OK) && noslip_within_f(added, self->limit) &&
        noslip_is_finite_f(rounded)) {
        self->z = next;
        self->rounded = rounded;
        self->added = added;
    } else if ((self->z > 0) != (part > 0)) { /* decrease, but not past zero */
        self->z = 0;
        self->rounded = 0;
        self->added = 0;
    }
    self->error = error;
    *add = self->added;
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
