/*
 * noslip_slip.h - notices that wheels slip, and lowers the friction that is believed for a while.
 *
 * A gyro turns with the vehicle, and so do the wheels as long as they roll: heading = turn[0] angle[0] + turn[1] angle[1]. With an
 * accelerometer the speed is compared too. Both are compared over the last moments, `window`. The wheels slip where the difference
 * is larger than all errors together may make it:
 *
 *     |turn[i]| (count[i] + geometry |angle[i]|) for each wheel + gyro_bias * time + deviations * (standard deviation)
 *
 * The counts of an encoder, the geometry and the bias are bounds, of which the first does not grow with time. Only noise is random:
 * the probability of a false alarm is at most that of a normal number beyond `deviations`, at each call: with 6 it is 2e-9, less
 * than one in 1000 hours at 100 Hz, for each of the two comparisons.
 *
 *     noslip_odometry_differential_f(&vehicle, r, b, d);
 *     noslip_slip_init_f(&slip, &slip_options, &vehicle);
 *     ...
 *     status = noslip_slip_step_f(&slip, &reading, dt, &noticed);         at each call, before the step of the law
 *     noslip_slip_grip_f(&slip, &law.earned, &law.grip);                  the law keeps its wheels within noticed.mu
 *     reference.speed *= noticed.slower;                                  and speed_rate alike
 *
 * noticed.slower is the root of mu over that of the options: all accelerations along the path are then less by mu.
 *
 * Each time slip is noticed, mu is multiplied by `lower`, down to `least`; slip that goes on is noticed again. It rises by `rise`
 * per second once nothing was noticed for `hold`. Dead reckoning is wrong by what slipped: uncertain_heading and uncertain_way grow
 * by the difference of the heading and by the way of the wheels in the window; noslip_slip_trust, after a correction, clears them.
 *
 * What is not noticed: without accelerations, slip alike of both wheels, as in braking straight ahead; and slip sideways alone. In
 * place of an accelerometer, the acceleration may be the one that the law desired, with an acceleration_bias that covers what
 * the model lacks, where its step returned NOSLIP_OK; else it is not known. A mean over a call is meant: of a gyro that is sampled
 * at the calls, take the mean of two readings.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_SLIP_H
#define NOSLIP_SLIP_H

#include "noslip_grip.h"
#include "noslip_odometry.h"

#define NOSLIP_MODULE "noslip_slip.inc"
#include "noslip_scalars.inc"

#endif
