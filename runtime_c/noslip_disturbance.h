/*
 * noslip_disturbance.h - disturbance observer: estimates and compensates what a wrong model or a load adds to an output's motion.
 *
 * After exact linearization an output of relative degree r obeys y^(r) = v + d, with d = 0 only if the model is right and nothing
 * else acts. The last derivative below that, y^(r-1), is measured: y' for relative degree 2, y for 1. Between two calls, dt
 * apart, v is held and y^(r-1) grows by dt (v + d), exactly if d is constant, so that its change shows d. The estimate follows
 * it with the rate l (1/s), and is subtracted from v:
 *
 *     estimate += l dt / (1 + l dt) ((change of y^(r-1)) / dt - v - estimate)
 *
 * Its error becomes smaller by the factor 1 / (1 + l dt) at each call. Without limits the poles of the output stay where its
 * gains place them, for any l: one more, at z = 1 / (1 + l dt), is that of the estimate. Integral action (noslip_integral.h) has
 * the same poles with ki = l kp, kp + l kd instead of kp, and kd + l instead of kd, but answers to each deviation from the desired
 * output, which it overshoots; the estimate does not change while the robot moves as the model says.
 *
 *     noslip_disturbance_init(&distance, l, limit);
 *
 * At each call, with the `status` that the last step of the law returned, initially NOSLIP_OK, here for relative degree 2:
 *
 *     labmate_type_iv_circle_output(&law, &state, y);
 *     labmate_type_iv_circle_rate(&law, &state, ydot);
 *     v = gains.kd_distance * (reference.distance_rate - ydot[0]) + gains.kp_distance * (reference.distance - y[0]);
 *     noslip_disturbance_step(&distance, ydot[0], v, dt, status, &added);
 *     reference.distance_acceleration = added;              plus the desired one, if any, which is a part of v too
 *     status = labmate_type_iv_circle_step(&law, &state, &reference, tau);
 *
 * While inputs are saturated, the v that acts is not that of the law, and the estimate stays. It never exceeds its limit. The
 * estimate amplifies noise of y^(r-1) by up to l.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_DISTURBANCE_H
#define NOSLIP_DISTURBANCE_H

#include "noslip_controller.h"

/* -- double: generated from noslip_disturbance.inc by guarantees/headers.py -------------------------------------------- */

/* Disturbance observer of one output: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_disturbance {
    double rate;          /* 1/s: how fast the estimate follows */
    double limit;         /* maximum of |estimate| */
    double estimate;      /* of d, in the unit of v */
    double measured;      /* at the last step */
    double v;             /* virtual input from the last step on, the estimate subtracted */
    int begun;            /* whether there was a step */
    int ready;
} noslip_disturbance;

/*
 * Initializes with an estimate of 0, the rate (1/s) and the maximum of the |estimate| (0: no limit), in the unit of v.
 * Returns NOSLIP_BAD_PARAMETER unless both are finite and not negative. With a rate of 0 the estimate stays.
 */
NOSLIP_NODISCARD static inline int noslip_disturbance_init(noslip_disturbance *self, double rate,
                                         double limit)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_finite(rate) && rate >= 0 && noslip_is_limit(limit))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->rate = rate;
    self->limit = noslip_limit(limit);
    self->estimate = 0;
    self->measured = 0;
    self->v = 0;
    self->begun = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Restarts from an estimate: the next step subtracts it, and compares with nothing before it. Use it for a new task, and where
 * the measured value jumps.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER if it exceeds the limit.
 */
static inline int noslip_disturbance_reset(noslip_disturbance *self, double estimate)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite(estimate)) {
        return NOSLIP_NONFINITE;
    }
    if (!noslip_within(estimate, self->limit)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->estimate = estimate;
    self->begun = 0;
    return NOSLIP_OK;
}

/*
 * Tells the virtual input that acts from the last step on, where something other than the law limits it: the next step, with the
 * status NOSLIP_OK, compares with it.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int noslip_disturbance_applied(noslip_disturbance *self, double v)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite(v)) {
        return NOSLIP_NONFINITE;
    }
    self->v = v;
    return NOSLIP_OK;
}

/*
 * Writes minus the estimate to `add`. `measured` is the output's derivative below the relative degree now, `v` the virtual input
 * now without the estimate, `dt` (s) the time since the last step. The estimate stays at the first step, if dt is 0, and if
 * `status`, which the step of the law returned at the previous call, is not NOSLIP_OK: it is not known then which v acted.
 * On an error nothing changes, and `add` is that of before, or 0 without `self`: NOSLIP_NULL, NOSLIP_NOT_READY,
 * NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER (negative dt).
 */
static inline int noslip_disturbance_step(noslip_disturbance *self, double measured, double v,
                   double dt, int status, double *add)
{
    double estimate, follows, found;
    if (add == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        *add = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    *add = -self->estimate;
    if (!(noslip_is_finite(measured) && noslip_is_finite(v) && noslip_is_finite(dt))) {
        return NOSLIP_NONFINITE;
    }
    if (dt < 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    estimate = self->estimate;
    if (self->begun && status == NOSLIP_OK && dt > 0) {
        follows = self->rate * dt / (1 + self->rate * dt);
        found = estimate + follows * ((measured - self->measured) / dt - self->v - estimate);
        if (noslip_is_finite(found)) {
            estimate = noslip_clip(found, self->limit);
        }
    }
    if (!noslip_is_finite(v - estimate)) {
        return NOSLIP_NONFINITE;
    }
    self->estimate = estimate;
    self->measured = measured;
    self->v = v - estimate;
    self->begun = 1;
    *add = -estimate;
    return NOSLIP_OK;
}

/* -- float: generated from noslip_disturbance.inc by guarantees/headers.py --------------------------------------------- */

/* Disturbance observer of one output: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_disturbance_f {
    float rate;           /* 1/s: how fast the estimate follows */
    float limit;          /* maximum of |estimate| */
    float estimate;       /* of d, in the unit of v */
    float measured;       /* at the last step */
    float v;              /* virtual input from the last step on, the estimate subtracted */
    int begun;            /* whether there was a step */
    int ready;
} noslip_disturbance_f;

/*
 * Initializes with an estimate of 0, the rate (1/s) and the maximum of the |estimate| (0: no limit), in the unit of v.
 * Returns NOSLIP_BAD_PARAMETER unless both are finite and not negative. With a rate of 0 the estimate stays.
 */
NOSLIP_NODISCARD static inline int noslip_disturbance_init_f(noslip_disturbance_f *self, float rate,
                                            float limit)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_finite_f(rate) && rate >= 0 && noslip_is_limit_f(limit))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->rate = rate;
    self->limit = noslip_limit_f(limit);
    self->estimate = 0;
    self->measured = 0;
    self->v = 0;
    self->begun = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Restarts from an estimate: the next step subtracts it, and compares with nothing before it. Use it for a new task, and where
 * the measured value jumps.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER if it exceeds the limit.
 */
static inline int noslip_disturbance_reset_f(noslip_disturbance_f *self, float estimate)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite_f(estimate)) {
        return NOSLIP_NONFINITE;
    }
    if (!noslip_within_f(estimate, self->limit)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->estimate = estimate;
    self->begun = 0;
    return NOSLIP_OK;
}

/*
 * Tells the virtual input that acts from the last step on, where something other than the law limits it: the next step, with the
 * status NOSLIP_OK, compares with it.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int noslip_disturbance_applied_f(noslip_disturbance_f *self, float v)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite_f(v)) {
        return NOSLIP_NONFINITE;
    }
    self->v = v;
    return NOSLIP_OK;
}

/*
 * Writes minus the estimate to `add`. `measured` is the output's derivative below the relative degree now, `v` the virtual input
 * now without the estimate, `dt` (s) the time since the last step. The estimate stays at the first step, if dt is 0, and if
 * `status`, which the step of the law returned at the previous call, is not NOSLIP_OK: it is not known then which v acted.
 * On an error nothing changes, and `add` is that of before, or 0 without `self`: NOSLIP_NULL, NOSLIP_NOT_READY,
 * NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER (negative dt).
 */
static inline int noslip_disturbance_step_f(noslip_disturbance_f *self, float measured, float v,
                     float dt, int status, float *add)
{
    float estimate, follows, found;
    if (add == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        *add = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    *add = -self->estimate;
    if (!(noslip_is_finite_f(measured) && noslip_is_finite_f(v) && noslip_is_finite_f(dt))) {
        return NOSLIP_NONFINITE;
    }
    if (dt < 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    estimate = self->estimate;
    if (self->begun && status == NOSLIP_OK && dt > 0) {
        follows = self->rate * dt / (1 + self->rate * dt);
        found = estimate + follows * ((measured - self->measured) / dt - self->v - estimate);
        if (noslip_is_finite_f(found)) {
            estimate = noslip_clip_f(found, self->limit);
        }
    }
    if (!noslip_is_finite_f(v - estimate)) {
        return NOSLIP_NONFINITE;
    }
    self->estimate = estimate;
    self->measured = measured;
    self->v = v - estimate;
    self->begun = 1;
    *add = -estimate;
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
