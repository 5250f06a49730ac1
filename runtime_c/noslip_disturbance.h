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

#define NOSLIP_MODULE "noslip_disturbance.inc"
#include "noslip_scalars.inc"

#endif
