/*
 * noslip_integral.h - integral action: makes an error die out that a wrong model or a load would leave.
 *
 * A law has no memory. What its outer loop lacks is added to the wanted highest derivative of an output, so that
 *
 *     v = (y_d'' + ki z) + kd (y_d' - y') + kp (y_d - y)    relative degree 2, stable where 0 < ki < kp kd
 *     v = (y_d' + ki z) + kv (y_d - y)                      relative degree 1, stable where 0 < ki and 0 < kv
 *
 * with z the integral of y_d - y. One struct for each output that has it:
 *
 *     noslip_integral_init(&distance, ki, limit);
 *
 * and at each call, `status` being what the law's step answered the last time, NOSLIP_OK before:
 *
 *     labmate_type_iv_circle_output(&law, &state, y);
 *     noslip_integral_step(&distance, reference.distance - y[0], dt, status, &added);
 *     reference.distance_acceleration = added;              plus what is wanted anyway; speed_rate for the speed
 *     status = labmate_type_iv_circle_step(&law, &state, &reference, tau);
 *
 * Where the output is a heading, take the error the short way round (noslip_angle.h).
 *
 * Against windup: |z| does not grow while inputs are saturated, nor where ki |z| would become larger than the limit; back to
 * zero it always may go. So |added| <= limit at every step, and as long as a start from z = 0 is saturated, the inputs are
 * those of the law without integral action. Sums are compensated (Kahan): float does not lose small steps.
 *
 * Each function exists for double and, with the suffix _f, for float; both come from noslip_integral.inc.
 */
#ifndef NOSLIP_INTEGRAL_H
#define NOSLIP_INTEGRAL_H

#include "noslip_controller.h"

#define NOSLIP_REAL double
#define NOSLIP_NAME(name) name
#include "noslip_integral.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#define NOSLIP_REAL float
#define NOSLIP_NAME(name) name##_f
#include "noslip_integral.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#endif
