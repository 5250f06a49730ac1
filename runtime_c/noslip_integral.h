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

#define NOSLIP_MODULE "noslip_integral.inc"
#include "noslip_scalars.inc"

#endif
